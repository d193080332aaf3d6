//! Tags of elements: group and element number in one number.

macro_rules! tags {
    ($($name:ident = $value:literal;)*) => {
        $(pub const $name: u32 = $value;)*
        /// Tags that are kept, by rising number.
        pub const KEPT: &[u32] = &[$($value),*];
    };
}
tags! {
    SOP_INSTANCE = 0x0008_0018;
    MODALITY = 0x0008_0060;
    SERIES_DESCRIPTION = 0x0008_103e;
    THICKNESS = 0x0018_0050;
    SPACING_BETWEEN_SLICES = 0x0018_0088;
    SERIES_UID = 0x0020_000e;
    SERIES_NUMBER = 0x0020_0011;
    INSTANCE_NUMBER = 0x0020_0013;
    POSITION = 0x0020_0032;
    ORIENTATION = 0x0020_0037;
    PLANE_POSITION = 0x0020_9113;
    PLANE_ORIENTATION = 0x0020_9116;
    SAMPLES = 0x0028_0002;
    PHOTOMETRIC = 0x0028_0004;
    FRAMES = 0x0028_0008;
    ROWS = 0x0028_0010;
    COLUMNS = 0x0028_0011;
    PIXEL_SPACING = 0x0028_0030;
    BITS_ALLOCATED = 0x0028_0100;
    BITS_STORED = 0x0028_0101;
    HIGH_BIT = 0x0028_0102;
    SIGNED = 0x0028_0103;
    PADDING = 0x0028_0120;
    PADDING_LIMIT = 0x0028_0121;
    INTERCEPT = 0x0028_1052;
    SLOPE = 0x0028_1053;
    LOOKUP = 0x0028_3000;
    PIXEL_MEASURES = 0x0028_9110;
    PIXEL_VALUES = 0x0028_9145;
    REAL_WORLD = 0x0040_9096;
    REAL_LAST_SHORT = 0x0040_9211;
    REAL_LOOKUP = 0x0040_9212;
    REAL_LAST = 0x0040_9213;
    REAL_FIRST = 0x0040_9214;
    REAL_FIRST_SHORT = 0x0040_9216;
    REAL_INTERCEPT = 0x0040_9224;
    REAL_SLOPE = 0x0040_9225;
    FRAME_OFFSETS = 0x3004_000c;
    DOSE_SCALING = 0x3004_000e;
    SHARED = 0x5200_9229;
    PER_FRAME = 0x5200_9230;
}
pub const TRANSFER_SYNTAX: u32 = 0x0002_0010;
pub const FLOAT_PIXELS: u32 = 0x7fe0_0008;
pub const DOUBLE_PIXELS: u32 = 0x7fe0_0009;
pub const PIXELS: u32 = 0x7fe0_0010;
pub const ITEM: u32 = 0xfffe_e000;
pub const ITEM_END: u32 = 0xfffe_e00d;
pub const SEQUENCE_END: u32 = 0xfffe_e0dd;
