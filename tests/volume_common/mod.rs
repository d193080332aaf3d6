//! Writes a volume in every format that is read, independently of the readers.
#![allow(dead_code)] // each test file uses a part

use alvis::volume::{Dtype, Endian, OpenOptions, Opened, Volume, open};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder of real volumes, if this machine has it.
pub fn data() -> Option<PathBuf> {
    let dir = std::env::var_os("ALVIS_DATA").map_or_else(|| "../shared/data".into(), PathBuf::from);
    if dir.is_dir() {
        return Some(dir);
    }
    println!(
        "SKIPPED: no real volumes in {}; set ALVIS_DATA",
        dir.display()
    );
    None
}

/// A volume as the bytes of its samples, least significant byte first.
#[derive(Debug, Clone)]
pub struct Sample {
    pub dims: [u64; 3],
    pub dtype: Dtype,
    pub endian: Endian,
    pub little: Vec<u8>,
}

macro_rules! forms {
    ($($name:ident),* $(,)?) => {
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Form {
            $($name),*
        }

        pub const FORMS: &[Form] = &[$(Form::$name),*];
    };
}

forms![
    Raw,
    RawGz,
    Mha,
    MhaZlib,
    Mhd,
    MhdZlib,
    MhdSkip,
    MhdEnd,
    MhdList,
    MhdPattern,
    Nrrd,
    NrrdGz,
    NrrdMembers,
    NrrdSkip,
    NrrdGzSkip,
    Nhdr,
    NhdrEnd,
    NhdrGz,
    NhdrRows,
    NhdrSlices,
    NhdrSlab,
    NhdrList,
    NhdrGzSlices,
];

use Form::*;

impl Form {
    pub fn compressed(self) -> bool {
        matches!(
            self,
            RawGz | MhaZlib | MhdZlib | NrrdGz | NrrdMembers | NrrdGzSkip | NhdrGz | NhdrGzSlices
        )
    }

    fn is_metaimage(self) -> bool {
        matches!(
            self,
            Mha | MhaZlib | Mhd | MhdZlib | MhdSkip | MhdEnd | MhdList | MhdPattern
        )
    }
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

impl Sample {
    /// Sample bytes as the file has them.
    pub fn stored(&self) -> Vec<u8> {
        self.ordered(self.endian)
    }

    /// Sample bytes as the machine has them.
    pub fn native(&self) -> Vec<u8> {
        self.ordered(Endian::NATIVE)
    }

    fn ordered(&self, endian: Endian) -> Vec<u8> {
        let mut bytes = self.little.clone();
        if endian == Endian::Big {
            bytes
                .chunks_exact_mut(self.dtype.bytes())
                .for_each(<[u8]>::reverse);
        }
        bytes
    }

    /// A box cut out sample by sample.
    pub fn cut(&self, [x, y, z]: [std::ops::Range<u32>; 3]) -> Vec<u8> {
        let (native, n) = (self.native(), self.dtype.bytes());
        let [nx, ny, _] = self.dims.map(|d| d as u32);
        let mut out = Vec::new();
        for k in z {
            for j in y.clone() {
                for i in x.clone() {
                    let at = (i + nx * (j + ny * k)) as usize * n;
                    out.extend_from_slice(&native[at..at + n]);
                }
            }
        }
        out
    }

    /// What has to be said of a raw file.
    pub fn options(&self, form: Form) -> OpenOptions {
        match form {
            Raw | RawGz => OpenOptions {
                dims: Some(self.dims),
                dtype: Some(self.dtype),
                endian: Some(self.endian),
                ..OpenOptions::default()
            },
            _ => OpenOptions::default(),
        }
    }

    /// Writes the volume below `dir` and returns the path to open.
    pub fn write(&self, dir: &Path, form: Form) -> PathBuf {
        let data = self.stored();
        match form {
            Raw => put(dir, "v.raw", &data),
            RawGz => put(dir, "v.raw.gz", &gzip(&data)),
            _ if form.is_metaimage() => self.write_metaimage(dir, form, &data),
            _ => self.write_nrrd(dir, form, &data),
        }
    }

    fn write_metaimage(&self, dir: &Path, form: Form, data: &[u8]) -> PathBuf {
        let [nx, ny, nz] = self.dims;
        let name = match self.dtype {
            Dtype::U8 => "UCHAR",
            Dtype::I8 => "CHAR",
            Dtype::U16 => "USHORT",
            Dtype::I16 => "SHORT",
            Dtype::U32 => "UINT",
            Dtype::I32 => "INT",
            Dtype::F32 => "FLOAT",
            Dtype::F64 => "DOUBLE",
        };
        let big = if self.endian == Endian::Big {
            "True"
        } else {
            "False"
        };
        let compressed = if form.compressed() { "True" } else { "False" };
        let mut head = format!(
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = {big}\n\
             CompressedData = {compressed}\nDimSize = {nx} {ny} {nz}\nElementType = MET_{name}\n"
        );
        let slice = data.len() / nz as usize;
        let slices = |pattern: &dyn Fn(usize) -> String| {
            for (k, slice) in data.chunks(slice).enumerate() {
                put(dir, &pattern(k), slice);
            }
        };
        let mut local = Vec::new();
        let file = match form {
            Mha | MhaZlib => {
                local = if form == Mha {
                    data.to_vec()
                } else {
                    zlib(data)
                };
                "LOCAL".into()
            }
            MhdZlib => {
                put(dir, "v.zraw", &zlib(data));
                "v.zraw".into()
            }
            MhdSkip => {
                head += "HeaderSize = 5\n";
                put(dir, "v.raw", &[b"front", data, b"behind"].concat());
                "v.raw".into()
            }
            MhdEnd => {
                head += "HeaderSize = -1\n";
                put(dir, "v.raw", &[b"in front", data].concat());
                "v.raw".into()
            }
            MhdList => {
                slices(&|k| format!("a slice {k}.bin"));
                let names: Vec<String> = (0..nz).map(|k| format!("a slice {k}.bin")).collect();
                format!("LIST\n{}", names.join("\n"))
            }
            MhdPattern => {
                slices(&|k| format!("s{:03}.bin", 10 + 2 * k));
                format!("s%03d.bin 10 {} 2", 10 + 2 * (nz - 1))
            }
            _ => {
                put(dir, "v.raw", data);
                "v.raw".into()
            }
        };
        let head = format!("{head}ElementDataFile = {file}\n");
        put(dir, "v.mhd", &[head.as_bytes(), &local].concat())
    }

    fn write_nrrd(&self, dir: &Path, form: Form, data: &[u8]) -> PathBuf {
        let [nx, ny, nz] = self.dims;
        let name = match self.dtype {
            Dtype::U8 => "unsigned char",
            Dtype::I8 => "int8_t",
            Dtype::U16 => "ushort",
            Dtype::I16 => "signed short int",
            Dtype::U32 => "uint32",
            Dtype::I32 => "int",
            Dtype::F32 => "float",
            Dtype::F64 => "double",
        };
        let encoding = if form.compressed() { "gzip" } else { "raw" };
        let mut head = format!(
            "NRRD0004\n# a comment: with a colon\nkey:=value\ntype: {name}\ndimension: 3\n\
             sizes: {nx} {ny} {nz}\nendian: {}\nencoding: {encoding}\n",
            self.endian
        );
        let parts = |count: u64| {
            for (i, part) in data.chunks(data.len() / count as usize).enumerate() {
                let part = if form.compressed() {
                    gzip(part)
                } else {
                    part.to_vec()
                };
                put(dir, &format!("p.{i}"), &part);
            }
        };
        let mut attached = Vec::new();
        match form {
            Nrrd => attached = data.to_vec(),
            NrrdGz => attached = gzip(data),
            NrrdMembers => {
                let (a, b) = data.split_at(data.len() / 3);
                attached = [gzip(a), gzip(&[]), gzip(b), vec![0; 100]].concat();
            }
            NrrdSkip => {
                head += "line skip: 2\nbyte skip: 3\n";
                attached = [b"one\ntwo\nxyz", data].concat();
            }
            NrrdGzSkip => {
                head += "lineskip: 1\nbyteskip: 3\n";
                attached = [b"one\n".to_vec(), gzip(&[b"xyz", data].concat())].concat();
            }
            Nhdr | NhdrEnd | NhdrGz => {
                let bytes = match form {
                    Nhdr => data.to_vec(),
                    NhdrGz => gzip(data),
                    _ => [b"in front", data, b"z"].concat(),
                };
                put(dir, "the data.bin", &bytes);
                head += if form == NhdrEnd {
                    "byte skip: -2\n"
                } else {
                    ""
                };
                head += "data file: the data.bin\n";
            }
            NhdrRows => {
                parts(ny * nz);
                head += &format!("data file: p.%d 0 {} 1 1\n", ny * nz - 1);
            }
            NhdrSlices | NhdrGzSlices => {
                parts(nz);
                head += &format!("datafile: ./p.%d 0 {} 1\n", nz - 1);
            }
            NhdrSlab => {
                let count = (2..=nz).find(|n| nz % n == 0).unwrap();
                parts(count);
                head += &format!("data file: p.%d 0 {} 1 3\n", count - 1);
            }
            _ => {
                parts(nz);
                let names: Vec<String> = (0..nz).map(|k| format!("p.{k}\r\n")).collect();
                head += &format!("data file: LIST\n{}", names.concat());
            }
        }
        if !attached.is_empty() {
            head += "\n";
        }
        put(dir, "v.nrrd", &[head.as_bytes(), &attached].concat())
    }
}

fn put(dir: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = dir.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// All samples of a volume.
pub fn all(volume: &dyn Volume) -> alvis::Result<Vec<u8>> {
    let header = volume.header();
    let [nx, ny, nz] = header.dims.0;
    let mut out = vec![0; header.dims.voxels() as usize * header.dtype.bytes()];
    volume.read_box(0..nx, 0..ny, 0..nz, &mut out)?;
    Ok(out)
}

/// Opens a file of these bytes with options.
pub fn open_as(name: &str, bytes: &[u8], options: &OpenOptions) -> alvis::Result<Opened> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    open(&path, options)
}

/// Opens a file of these bytes.
pub fn opened(name: &str, parts: &[&[u8]]) -> Opened {
    open_as(name, &parts.concat(), &OpenOptions::default()).unwrap()
}

/// Values of a volume whose type is f32.
pub fn floats(opened: &Opened) -> Vec<f32> {
    assert_eq!(opened.volume.header().dtype, Dtype::F32);
    let bytes = all(&*opened.volume).unwrap();
    let words = bytes.as_chunks::<4>().0.iter();
    words.map(|w| f32::from_ne_bytes(*w)).collect()
}

/// True if one of the words for people has a part.
pub fn says(warnings: &[String], part: &str) -> bool {
    warnings.iter().any(|warning| warning.contains(part))
}

/// A TIFF of one page of 3 x 2 pixels of 8 bits.
pub fn tiff_page(pixels: [u8; 6]) -> Vec<u8> {
    let tags: [(u16, u32); 9] = [
        (256, 3),
        (257, 2),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, 2),
        (279, 6),
    ];
    let mut out = [&b"II*\0\x10\0\0\0"[..], &pixels, &[0, 0]].concat();
    out.extend((tags.len() as u16).to_le_bytes());
    for (tag, value) in tags {
        out.extend(tag.to_le_bytes());
        out.extend([4, 0, 1, 0, 0, 0]);
        out.extend(value.to_le_bytes());
    }
    out.extend([0; 4]);
    out
}
