//! A field as a volume.

use crate::cubes::Field;
use alvis::grid::{Dims, Placement};
use alvis::volume::{Dtype, Endian, Header, Volume};
use std::ops::Range;

pub struct Samples {
    header: Header,
    values: Vec<f32>,
}

impl Samples {
    pub fn new(field: &Field) -> Self {
        Samples {
            header: Header {
                format: "test",
                dims: Dims(field.dims.map(|n| n as u32)),
                dtype: Dtype::F32,
                endian: Endian::Little,
                placement: Placement::default(),
            },
            values: field.values.clone(),
        }
    }
}

impl Volume for Samples {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(
        &self,
        x: Range<u32>,
        y: Range<u32>,
        z: Range<u32>,
        out: &mut [u8],
    ) -> alvis::Result<()> {
        let mut out = out.chunks_exact_mut(4);
        for k in z {
            for j in y.clone() {
                for i in x.clone() {
                    let v = self.values[self.header.dims.linear([i, j, k]) as usize];
                    out.next().unwrap().copy_from_slice(&v.to_ne_bytes());
                }
            }
        }
        assert!(out.next().is_none());
        Ok(())
    }
}
