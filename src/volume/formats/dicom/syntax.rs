//! Transfer syntaxes: how the pixels of a frame are packed.

use crate::error::{Error, Result};
use std::path::Path;

/// The packing of a frame. The names are those of
/// <https://dicom.nema.org/medical/dicom/current/output/html/part06.html#chapter_A>.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Syntax {
    /// As they are, in either byte order; also in a data set that is packed as a whole.
    Native,
    /// Byte planes in run lengths.
    Rle,
    /// JPEG, lossless or of 8 bits.
    Jpeg,
    JpegLs,
    Jpeg2000,
}

impl Syntax {
    /// The packing of a transfer syntax.
    ///
    /// # Errors
    /// [`Error::Unsupported`] by name for those that are not unpacked.
    pub(crate) fn find(path: &Path, uid: &str) -> Result<Syntax> {
        let name = match uid.strip_prefix("1.2.840.10008.1.2") {
            Some("" | ".1" | ".1.99" | ".2") => return Ok(Syntax::Native),
            Some(".5") => return Ok(Syntax::Rle),
            Some(".4.50" | ".4.57" | ".4.70") => return Ok(Syntax::Jpeg),
            Some(".4.80" | ".4.81") => return Ok(Syntax::JpegLs),
            Some(".4.90" | ".4.91") => return Ok(Syntax::Jpeg2000),
            Some(".4.51" | ".4.52" | ".4.53" | ".4.54" | ".4.55" | ".4.56") => "JPEG of 12 bits",
            Some(".4.92" | ".4.93") => "JPEG 2000 of several components",
            Some(".4.110" | ".4.111" | ".4.112") => "JPEG XL",
            Some(".4.201" | ".4.202" | ".4.203") => "High-Throughput JPEG 2000",
            Some(".8.1") => "Deflated Image Frame Compression",
            _ if uid.is_empty() => return Ok(Syntax::Native),
            _ => "",
        };
        let what = match name {
            "" => format!("the DICOM transfer syntax {uid}"),
            _ => format!("the DICOM transfer syntax {uid} ({name})"),
        };
        let hint = "convert the files to Explicit VR Little Endian, for example with `gdcmconv --raw` \
                    or `dcmdjpeg`";
        Err(Error::unsupported(path, what, hint))
    }

    /// True if pixels are in fragments that must be unpacked.
    pub(crate) fn is_packed(self) -> bool {
        self != Syntax::Native
    }
}
