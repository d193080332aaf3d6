//! Paths in buckets: `s3://bucket/key`.

use std::path::Path;

const SCHEME: &str = "s3://";

/// True for a path that names a bucket of S3-compatible storage.
pub(crate) fn is_remote(path: &Path) -> bool {
    path.as_os_str()
        .as_encoded_bytes()
        .starts_with(SCHEME.as_bytes())
}

/// A bucket and a key in it, which is empty for the whole of it.
#[cfg_attr(not(feature = "s3"), allow(dead_code))]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place<'a> {
    pub bucket: &'a str,
    pub key: &'a str,
}

#[cfg_attr(not(feature = "s3"), allow(dead_code))]
impl<'a> Place<'a> {
    /// Reads a path.
    ///
    /// # Errors
    /// [`std::io::ErrorKind::InvalidInput`] for a path that names no bucket, or a key with empty parts, `.` or `..`.
    pub fn of(path: &'a Path) -> std::io::Result<Self> {
        let wrong = |what: &str| {
            let text = format!("found {what}, expected s3://BUCKET/KEY");
            std::io::Error::new(std::io::ErrorKind::InvalidInput, text)
        };
        let text = path
            .to_str()
            .ok_or_else(|| wrong("a path that is not UTF-8"))?;
        let rest = text
            .strip_prefix(SCHEME)
            .ok_or_else(|| wrong("another path"))?;
        let (bucket, key) = rest.split_once('/').unwrap_or((rest, ""));
        if bucket.is_empty() {
            return Err(wrong("no name of a bucket"));
        }
        let key = key.trim_end_matches('/');
        let strange = |part: &str| matches!(part, "" | "." | "..");
        match !key.is_empty() && key.split('/').any(strange) {
            true => Err(wrong("a key with an empty part, . or ..")),
            false => Ok(Place { bucket, key }),
        }
    }
}

#[cfg(test)]
#[cfg(feature = "s3")]
mod tests {
    use super::*;

    #[test]
    fn paths_in_buckets() {
        let of = |text| Place::of(Path::new(text)).ok().map(|p| (p.bucket, p.key));
        assert_eq!(of("s3://b/a/c.raw"), Some(("b", "a/c.raw")));
        assert_eq!(of("s3://b/a/"), Some(("b", "a")));
        assert_eq!(of("s3://b"), Some(("b", "")));
        for bad in [
            "s3://",
            "s3:///a",
            "s3://b//a",
            "s3://b/a/../c",
            "s3://b/./c",
            "b/a",
        ] {
            assert_eq!(of(bad), None, "{bad}");
        }
        // as all that reads files joins paths
        let joined = Path::new("s3://b/set").join("tiles/z0000");
        assert_eq!(of(joined.to_str().unwrap()), Some(("b", "set/tiles/z0000")));
        assert_eq!(joined.parent().unwrap(), Path::new("s3://b/set/tiles"));
        assert!(is_remote(&joined) && !is_remote(Path::new("s3:/b")) && !is_remote(Path::new("b")));
    }
}
