//! Volumes around a volume: cropped, mirrored, scaled, resampled, copied to a file, watched while they are read.

pub(crate) mod crop;
pub(crate) mod decompress;
pub(crate) mod kind;
pub(crate) mod mirror;
pub(crate) mod permute;
pub(crate) mod resample;
pub(crate) mod temp_copy;
pub(crate) mod values;
