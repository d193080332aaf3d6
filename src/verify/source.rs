//! What the manifest states of its source, beside the volume that the tiles are compared with.

use super::code::Code;
use super::report::Issues;
use crate::manifest::Manifest;
use crate::volume::Header;

/// Compares format, size, type and byte order with those of the volume, before it was cut.
pub(super) fn check(manifest: &Manifest, header: &Header, issues: &mut Issues) {
    let source = &manifest.source;
    let mut compare = |name: &str, found: String, stated: String| {
        if found != stated {
            let message = format!("stated {stated}, the volume has {found}");
            issues.add(Code::SourceMismatch, format!("index.json#/source/{name}"), message);
        }
    };
    compare("format", header.format.to_owned(), source.format.clone());
    compare("dims", header.dims.to_string(), source.dims.to_string());
    compare("dtype", header.dtype.to_string(), source.dtype.to_string());
    // the order of single bytes says nothing
    if header.dtype.bytes() > 1 {
        compare("endian", header.endian.to_string(), source.endian.to_string());
    }
}
