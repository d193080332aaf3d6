//! A small writer of TIFF: little-endian, uncompressed, a strip for each page.

/// The value of a tag.
#[derive(Debug, Clone)]
pub enum Tag {
    Short(u16),
    Long(u32),
    Ratio(u32, u32),
    Text(Vec<u8>),
}

/// A page of 4 x 3 numbers of 16 bits.
#[derive(Debug, Clone)]
pub struct Page {
    pub size: [u32; 2],
    pub samples: Vec<u8>,
    pub tags: Vec<(u16, Tag)>,
}

pub fn text(text: &str) -> Tag {
    Tag::Text(text.as_bytes().to_vec())
}

/// The page of slice `z`: a voxel's value is x + 10 y + 100 z.
pub fn page(z: u32) -> Page {
    let values = (0..12).map(|i| (i % 4 + 10 * (i / 4) + 100 * z) as u16);
    Page {
        size: [4, 3],
        samples: values.flat_map(u16::to_le_bytes).collect(),
        tags: Vec::new(),
    }
}

/// The pages of these slices, the first with a description.
pub fn described(slices: impl IntoIterator<Item = u32>, description: &str) -> Vec<Page> {
    let mut pages: Vec<Page> = slices.into_iter().map(page).collect();
    pages[0].tags.push((270, text(description)));
    pages
}

/// The same tag for every page.
pub fn with(mut pages: Vec<Page>, tag: u16, value: Tag) -> Vec<Page> {
    pages
        .iter_mut()
        .for_each(|page| page.tags.push((tag, value.clone())));
    pages
}

/// A resolution for every page: unit, and pixels per unit along x and y as fractions.
pub fn resolved(pages: Vec<Page>, unit: u16, x: [u32; 2], y: [u32; 2]) -> Vec<Page> {
    let pages = with(pages, 296, Tag::Short(unit));
    let pages = with(pages, 282, Tag::Ratio(x[0], x[1]));
    with(pages, 283, Tag::Ratio(y[0], y[1]))
}

/// A file of these pages: samples in one piece, directories behind them.
pub fn file(pages: &[Page]) -> Vec<u8> {
    let mut out = b"II*\0\0\0\0\0".to_vec();
    let starts: Vec<u32> = pages
        .iter()
        .map(|page| {
            let at = out.len() as u32;
            out.extend(&page.samples);
            at
        })
        .collect();
    let mut link = 4;
    for (page, start) in pages.iter().zip(starts) {
        let [width, height] = page.size;
        let mut tags = vec![
            (256, Tag::Long(width)),
            (257, Tag::Long(height)),
            (
                258,
                Tag::Short(8 * (page.samples.len() as u32 / (width * height)) as u16),
            ),
            (259, Tag::Short(1)),
            (262, Tag::Short(1)),
            (273, Tag::Long(start)),
            (277, Tag::Short(1)),
            (278, Tag::Long(height)),
            (279, Tag::Long(page.samples.len() as u32)),
        ];
        tags.retain(|(tag, _)| page.tags.iter().all(|(other, _)| other != tag));
        tags.extend(page.tags.iter().cloned());
        tags.sort_by_key(|(tag, _)| *tag);
        let mut behind = Vec::new();
        let at = out.len() as u32;
        out[link..link + 4].copy_from_slice(&at.to_le_bytes());
        out.extend((tags.len() as u16).to_le_bytes());
        let end = at + 2 + 12 * tags.len() as u32 + 4;
        for (tag, value) in tags {
            let (kind, count, bytes) = match value {
                Tag::Short(n) => (3u16, 1, n.to_le_bytes().to_vec()),
                Tag::Long(n) => (4, 1, n.to_le_bytes().to_vec()),
                Tag::Ratio(a, b) => (5, 1, [a.to_le_bytes(), b.to_le_bytes()].concat()),
                Tag::Text(text) => (2, text.len() as u32 + 1, [&text[..], &[0]].concat()),
            };
            out.extend(tag.to_le_bytes());
            out.extend(kind.to_le_bytes());
            out.extend(u32::to_le_bytes(count));
            let mut inside = [0; 4];
            if bytes.len() > 4 {
                inside = (end + behind.len() as u32).to_le_bytes();
                behind.extend(bytes);
            } else {
                inside[..bytes.len()].copy_from_slice(&bytes);
            }
            out.extend(inside);
        }
        link = out.len();
        out.extend([0; 4]);
        out.extend(behind);
    }
    out
}
