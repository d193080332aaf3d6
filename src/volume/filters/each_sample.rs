//! A volume each of whose samples follows from the sample in its place alone.

use crate::error::Result;
use crate::volume::{Header, Volume, Voxel, hand_on};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Changes samples, given as bytes in the machine's order.
type Change = Arc<dyn Fn(&mut [u8]) + Send + Sync>;

/// A volume that hands out the samples of another one after a change. It needs no memory of its own.
pub(crate) struct EachSample<'a> {
    inner: Box<dyn Volume + 'a>,
    change: Change,
}

impl<'a> EachSample<'a> {
    /// `change` is for samples of the volume's type, which is `T`.
    pub(crate) fn new<T: Voxel>(
        inner: Box<dyn Volume + 'a>,
        change: impl Fn(T) -> T + Send + Sync + 'static,
    ) -> Self {
        let change = move |bytes: &mut [u8]| {
            for sample in bytes.chunks_exact_mut(size_of::<T>()) {
                let changed = change(bytemuck::pod_read_unaligned(sample));
                sample.copy_from_slice(bytemuck::bytes_of(&changed));
            }
        };
        EachSample {
            inner,
            change: Arc::new(change),
        }
    }
}

impl Volume for EachSample<'_> {
    fn header(&self) -> &Header {
        self.inner.header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        self.inner.read_box(x, y, z, out)?;
        (self.change)(out);
        Ok(())
    }

    hand_on!(inner);

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.inner.decoded_once(dir)?;
        Ok(once.map(|inner| -> Box<dyn Volume + '_> {
            Box::new(EachSample {
                inner,
                change: self.change.clone(),
            })
        }))
    }

    fn held_bytes(&self) -> u64 {
        self.inner.held_bytes()
    }
}
