//! Writes the corpus to start from: small files that alvis made, or that its own tests have.
//!
//! `cargo run --bin seeds -- corpus ../tests/fixtures`

use alvis_fuzz::{Set, forms};
use std::path::Path;

/// Fixtures up to this size are taken.
const SMALL: u64 = 2600;

fn main() -> std::io::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, corpus, fixtures] = &arguments[..] else {
        panic!("expected the corpus and the folder of fixtures");
    };
    let put = |target: &str, name: &str, bytes: &[u8]| {
        let dir = Path::new(corpus).join(target);
        std::fs::create_dir_all(&dir)?;
        std::fs::write(dir.join(name), bytes)
    };
    let set = Set::new(Default::default(), false);
    put("manifest", "whole", &std::fs::read(set.dir.join("index.json"))?)?;
    put("manifest", "short", &serde_json::to_vec(&set.manifest)?)?;
    put("shard", "whole", &std::fs::read(set.dir.join("index/z0000.json"))?)?;
    for (i, set) in forms().iter().enumerate() {
        let glb = set.tile_bytes();
        let whole = [&[i as u8], &glb[..]].concat();
        put("tile", &format!("form{i}"), &whole)?;
        put("strip", &format!("form{i}"), &[&[i as u8], &glb[glb.len() - 600..]].concat())?;
    }
    for (i, text) in EXPRESSIONS.iter().enumerate() {
        put("expression", &format!("e{i}"), text.as_bytes())?;
    }
    for (i, text) in HEADERS.iter().enumerate() {
        put("volume", &format!("h{i}"), &[&[0], text.as_bytes(), &[7; 24]].concat())?;
    }
    put("volume", "raw", &[&[1][..], &[9; 48]].concat())?;
    for place in [fixtures.clone(), format!("{fixtures}/dicom")] {
        for entry in std::fs::read_dir(place)? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let meta = entry.metadata()?;
            if meta.is_file() && meta.len() <= SMALL && !name.ends_with(".py") {
                put("volume", &name, &[&[0], &std::fs::read(entry.path())?[..]].concat())?;
            }
        }
    }
    Ok(())
}

const EXPRESSIONS: [&str; 6] = [
    "volume > 0.5 and not touches_border",
    "-2^2 * (area / volume) <= 1e-3 || missing(sphericity)",
    "max(axis_a, axis_b, 3) - min(1, log10(voxels)) = 0",
    "abs(sqrt(cbrt(exp(log(id))))) != true",
    "((((((((1))))))))",
    "!!not --1 >= .5e+2",
];

const HEADERS: [&str; 4] = [
    "ObjectType = Image\nNDims = 3\nDimSize = 2 3 4\nElementSpacing = 1 2 0.5\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
    "ObjectType = Image\nNDims = 3\nBinaryDataByteOrderMSB = True\nOffset = 1 -2 3e4\nTransformMatrix = 0 1 0 1 0 0 0 0 1\nCompressedData = False\nHeaderSize = -1\nDimSize = 2 2 3\nElementType = MET_SHORT\nElementDataFile = LOCAL\n",
    "NRRD0004\n# made up\ntype: uchar\ndimension: 3\nsizes: 2 3 4\nspacings: 1 2 0.5\nencoding: raw\n\n",
    "NRRD0005\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 2 3\nspace directions: (1,0,0) (0,2,0) (0,0,0.5)\nspace origin: (1,2,3)\nkinds: domain domain domain\nendian: big\nencoding: raw\nspace units: \"mm\" \"mm\" \"mm\"\n\n",
];
