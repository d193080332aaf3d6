//! What stands for buckets in a program that was built without them: one message.

use super::{Entry, Meta, Stamped};
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// There is none.
#[derive(Debug)]
pub(crate) enum Object {}

impl Object {
    pub fn open(_path: &Path) -> Result<Self> {
        refused()
    }

    pub fn open_for_parts(_path: &Path) -> Result<Self> {
        refused()
    }

    pub fn len(&self) -> u64 {
        match *self {}
    }

    pub fn read(&self, _position: u64, _out: &mut [u8]) -> Result<()> {
        match *self {}
    }
}

pub(super) fn metadata(_path: &Path) -> Result<Meta> {
    refused()
}

pub(super) fn is_object(_path: &Path) -> bool {
    false
}

pub(super) fn list(_path: &Path) -> Result<Vec<Entry>> {
    refused()
}

pub(super) fn stamps(_path: &Path) -> Result<Vec<Stamped>> {
    refused()
}

pub(super) fn put_file(_file: &Path, _to: &Path) -> Result<bool> {
    refused()
}

pub(super) fn probe(_dir: &Path) -> Result<bool> {
    refused()
}

fn refused<T>() -> Result<T> {
    Err(Error::new(
        ErrorKind::Unsupported,
        "s3:// needs a program built with --features s3 (`cargo install alvis --features s3`)",
    ))
}
