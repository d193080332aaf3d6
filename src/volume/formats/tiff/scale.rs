//! What stored numbers stand for, where a page says it: ImageJ's calibration of grey values, GDAL's scale, offset and
//! number for nothing.
//!
//! ImageJ's functions are those of `ij.measure.Calibration` and `ij.measure.CurveFitter`
//! (<https://github.com/imagej/ImageJ>), GDAL's tags those of its driver of GeoTIFF
//! (<https://gdal.org/en/stable/drivers/raster/gtiff.html>).

use crate::error::{Error, Result};
use crate::volume::Dtype;
use crate::volume::adapters::values::{Linear, Scale, Values};
use crate::volume::formats::tiff::ifd::Directory;
use crate::volume::formats::tiff::{imagej, xml};
use std::path::Path;

/// Names of ImageJ's functions by their numbers, where they are no straight line.
const FUNCTIONS: &[(i64, &str)] = &[
    (1, "2nd degree polynomial"),
    (2, "3rd degree polynomial"),
    (3, "4th degree polynomial"),
    (4, "exponential"),
    (5, "power"),
    (6, "log"),
    (7, "Rodbard"),
    (8, "gamma variate"),
    (9, "y = a + b ln(x - c)"),
    (10, "Rodbard (NIH Image)"),
    (11, "exponential with offset"),
    (12, "Gaussian"),
    (13, "exponential recovery"),
    (21, "uncalibrated optical density"),
    (22, "custom"),
];

/// The values that the samples of a page stand for; `None` if these are the samples.
///
/// # Errors
/// [`Error::Unsupported`] by name for a calibration that is no straight line.
pub(crate) fn values(
    path: &Path,
    dir: &Directory,
    dtype: Dtype,
    imagej: bool,
) -> Result<Option<Values>> {
    let by_gdal = gdal(path, dir, dtype)?;
    if by_gdal.is_none() && imagej {
        return calibration(path, &imagej::Text::new(&dir.text(270)?), dtype);
    }
    Ok(by_gdal)
}

/// The values by TIFF's tags and by a description, of which one alone may state any.
///
/// # Errors
/// [`Error::Unsupported`] if both do.
pub(crate) fn both(
    path: &Path,
    tags: Option<Values>,
    described: Option<Values>,
) -> Result<Option<Values>> {
    match (tags, described) {
        (Some(tags), Some(described)) => {
            let what = format!(
                "values by {} and by {} in the description",
                tags.stated_by, described.stated_by
            );
            let hint = "write the values themselves, or leave one of them out";
            Err(Error::unsupported(path, what, hint))
        }
        (tags, described) => Ok(tags.or(described)),
    }
}

/// ImageJ's calibration of grey values.
fn calibration(path: &Path, text: &imagej::Text, dtype: Dtype) -> Result<Option<Values>> {
    let Some(function) = text.number("cf") else {
        return Ok(None);
    };
    let no = |what: String| {
        let hint = "in ImageJ, Image > Type > 32-bit applies it: save the stack after that";
        Err(Error::unsupported(path, what, hint))
    };
    let function = function as i64;
    // 20 is none; numbers of 32 bits have no calibration, whatever the text says
    if function == 20 || dtype.bytes() > 2 {
        return Ok(None);
    }
    if function != 0 {
        let named = FUNCTIONS.iter().find(|(code, _)| *code == function);
        let name = named.map_or("unknown", |(_, name)| name);
        return no(format!(
            "ImageJ's calibration of grey values by a function that is no straight line (cf={function}, {name})"
        ));
    }
    if text.get("zeroclip") == Some("true") {
        return no("ImageJ's calibration of grey values with zeroclip=true".into());
    }
    let (Some(intercept), Some(slope)) = (text.number("c0"), text.number("c1")) else {
        return no(
            "ImageJ's calibration of grey values by a straight line (cf=0) without c0 and c1"
                .into(),
        );
    };
    // ImageJ holds signed numbers of 16 bits as unsigned ones that are larger by 32768
    let intercept = match dtype {
        Dtype::I16 => intercept + slope * 32768.0,
        Dtype::I8 => return no("ImageJ's calibration of signed numbers of 8 bits".into()),
        _ => intercept,
    };
    Ok(Values::linear(
        slope,
        intercept,
        "ImageJ's calibration, cf, c0 and c1",
    ))
}

/// GDAL's scale, offset and number for nothing.
fn gdal(path: &Path, dir: &Directory, dtype: Dtype) -> Result<Option<Values>> {
    let nothing = dir.text(42113)?;
    let items = dir.text(42112)?;
    if nothing.is_empty() && items.is_empty() {
        return Ok(None);
    }
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let nothing = number(&nothing)
        .filter(|n| !n.is_nan())
        .map(|n| match dtype {
            Dtype::F32 => f64::from(n as f32),
            _ => n,
        });
    let mut linear = Linear::SAME;
    let bad = |name: &str, text: &str| {
        let found = format!("GDAL's {name} of \"{text}\"");
        Error::format(path, found, "a number")
    };
    xml::elements(path, items.as_bytes(), |element| {
        let Some(text) = element.text.filter(|_| element.name == "Item") else {
            return Ok(());
        };
        match element
            .get("name")
            .map(|name| name.to_ascii_lowercase())
            .as_deref()
        {
            Some("scale") => linear.slope = number(text).ok_or_else(|| bad("scale", text))?,
            Some("offset") => linear.intercept = number(text).ok_or_else(|| bad("offset", text))?,
            _ => {}
        }
        Ok(())
    })?;
    if nothing.is_none() && linear == Linear::SAME {
        return Ok(None);
    }
    Ok(Some(Values {
        scale: Scale::All(linear),
        nothing: nothing.into_iter().collect(),
        valid: None,
        stated_by: "GDAL's tags".into(),
    }))
}
