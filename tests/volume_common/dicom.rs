//! Writes DICOM files element by element, independently of the reader.
#![allow(dead_code)] // each test file uses a part

/// Elements in Explicit VR Little Endian.
#[derive(Debug, Clone, Default)]
pub struct Set(Vec<u8>);

impl Set {
    fn element(mut self, tag: u32, kind: &str, mut value: Vec<u8>) -> Self {
        if value.len() % 2 == 1 {
            value.push(if kind == "UI" { 0 } else { b' ' });
        }
        self.0.extend(((tag >> 16) as u16).to_le_bytes());
        self.0.extend((tag as u16).to_le_bytes());
        self.0.extend(kind.bytes());
        if matches!(kind, "OW" | "SQ") {
            self.0.extend([0, 0]);
            self.0.extend((value.len() as u32).to_le_bytes());
        } else {
            self.0.extend((value.len() as u16).to_le_bytes());
        }
        self.0.extend(value);
        self
    }

    /// Decimal numbers or other text.
    pub fn text(self, tag: u32, kind: &str, value: &str) -> Self {
        self.element(tag, kind, value.as_bytes().to_vec())
    }

    pub fn short(self, tag: u32, value: u16) -> Self {
        self.element(tag, "US", value.to_le_bytes().to_vec())
    }

    /// The tag of another element.
    pub fn pointer(self, tag: u32, to: u32) -> Self {
        let [group, element] = [(to >> 16) as u16, to as u16];
        let value = [group.to_le_bytes(), element.to_le_bytes()].concat();
        self.element(tag, "AT", value)
    }

    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    pub fn double(self, tag: u32, value: f64) -> Self {
        self.element(tag, "FD", value.to_le_bytes().to_vec())
    }

    pub fn items(self, tag: u32, items: &[Set]) -> Self {
        let mut value = Vec::new();
        for item in items {
            value.extend([0xfe, 0xff, 0x00, 0xe0]);
            value.extend((item.0.len() as u32).to_le_bytes());
            value.extend(&item.0);
        }
        self.element(tag, "SQ", value)
    }

    pub fn with(mut self, other: &Set) -> Self {
        self.0.extend(&other.0);
        self
    }

    /// A file of 3 x 2 pixels in each frame, with the elements of a group below (0028,xxxx) first, and those above it.
    pub fn file(below: &Set, pixels: &[u16], frames: usize, above: &Set) -> Vec<u8> {
        let meta = Set::default().text(0x0002_0010, "UI", "1.2.840.10008.1.2.1");
        let image = Set::default()
            .short(0x0028_0002, 1)
            .text(0x0028_0004, "CS", "MONOCHROME2")
            .text(0x0028_0008, "IS", &frames.to_string())
            .short(0x0028_0010, 2)
            .short(0x0028_0011, 3);
        let bytes = pixels.iter().flat_map(|p| p.to_le_bytes()).collect();
        let all = meta
            .with(below)
            .with(&image)
            .with(above)
            .element(0x7fe0_0010, "OW", bytes);
        [&[0; 128][..], b"DICM", &all.0].concat()
    }
}
