//! `alvis serve`: the files of a tile set for other programs on this machine.

use super::{Outcome, output, stop};
use crate::error::Result;
use crate::http::{Rules, Server};
use crate::serve::Files;
use crate::tileset::TileSet;
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// Serve the files of a tile set to other viewers
///
/// Prints an address and serves index, tables and tiles below it until Ctrl-C, to programs on this machine and to pages
/// of the origins that are given. Other files of the directory are not served.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis serve OUT\n  \
    alvis serve OUT --port 8080 --allow-origin http://localhost:5173")]
pub struct ServeArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// Port of this machine to listen on, 0 for any that is free
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    /// Also answer pages of this origin, as in `https://viewer.example`; may be given several times
    #[arg(long, value_name = "URL", value_parser = origin)]
    allow_origin: Vec<String>,
    /// Say nothing but the address
    #[arg(short, long)]
    quiet: bool,
}

impl ServeArgs {
    pub fn run(self) -> Result<Outcome> {
        let set = TileSet::open(&self.out)?;
        let server = Server::bind(self.port)?;
        let rules = Rules::new(server.port(), self.allow_origin);
        let files = Files::new(set, rules.clone())?;
        stop::listen();
        output::print(&format!("{}/\n", server.address()))?;
        if !self.quiet {
            output::note("the index is index.json below this address; Ctrl-C ends it");
        }
        server.run(rules, files, stop::is_asked)?;
        Ok(Outcome::Done)
    }
}

/// An origin as browsers send it: scheme, host and port, in small letters and without an end.
fn origin(text: &str) -> Result<String, String> {
    let expected = "expected http:// or https:// and a host, and a port unless it is the usual one, with nothing behind: \
                    as in https://viewer.example or http://localhost:5173";
    let rest = text
        .strip_prefix("https://")
        .or_else(|| text.strip_prefix("http://"));
    let sound = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-.:[]".contains(c);
    match rest.filter(|rest| !rest.is_empty() && rest.chars().all(sound)) {
        Some(_) => Ok(text.to_owned()),
        None => Err(expected.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_are_what_browsers_send() {
        for good in [
            "https://a.example",
            "http://localhost:5173",
            "http://[::1]:80",
        ] {
            assert_eq!(origin(good).as_deref(), Ok(good));
        }
        for bad in [
            "",
            "*",
            "null",
            "a.example",
            "https://",
            "https://a.example/",
            "https://A.example",
            "ftp://a",
        ] {
            assert!(origin(bad).is_err(), "{bad}");
        }
    }
}
