//! `alvis view`: a tile set in the browser.

use super::against::{Against, Asked, open_against};
use super::filters::FilterArgs;
use super::input::Input;
use super::{Outcome, output, parse, stop};
use crate::error::{Error, Result};
use crate::http::{Rules, Server};
use crate::manifest::{MANIFEST, Manifest};
use crate::progress::Quiet;
use crate::tileset::TileSet;
use crate::view::{Shown, Slices, Told, Viewer, token};
use crate::volume::OpenOptions;
use clap::{Args, ValueHint};
use std::path::{Path, PathBuf};

/// Bytes of tiles on the graphics card, unless the user says otherwise.
const GPU_MEMORY: &str = "400MiB";

/// Look at a tile set in the browser
///
/// Prints an address and serves a page there until Ctrl-C. Only this machine can open it, and only with the whole
/// address: it ends in a secret. For tiles on another machine, give --port there and make a tunnel with the same number
/// at both ends: ssh -L 8080:127.0.0.1:8080 MACHINE.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis view OUT\n  \
    alvis view OUT --volume scan.mhd\n  \
    alvis view OUT --no-open --port 8080")]
pub struct ViewArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// Port of this machine to listen on, 0 for any that is free
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    /// Print the address only, and open no browser
    #[arg(long)]
    no_open: bool,
    /// Tiles that the page keeps on the graphics card; 2GiB is 2 * 2^30 bytes
    #[arg(long, value_name = "SIZE", default_value = GPU_MEMORY, value_parser = parse::bytes)]
    gpu_memory: u64,
    /// The volume that the tiles were made from, for slices [default: the file of its name beside OUT or here, unless it
    /// is younger than the tiles]
    #[arg(long, value_name = "INPUT", value_hint = ValueHint::FilePath)]
    volume: Option<PathBuf>,
    /// Say nothing but the address
    #[arg(short, long)]
    quiet: bool,
}

impl ViewArgs {
    /// As if the command was typed with a directory alone.
    pub fn of(out: &Path, quiet: bool) -> Self {
        ViewArgs {
            out: out.to_path_buf(),
            port: 0,
            no_open: false,
            gpu_memory: parse::bytes(GPU_MEMORY).unwrap_or_default(),
            volume: None,
            quiet,
        }
    }

    pub fn run(self) -> Result<Outcome> {
        let set = TileSet::open(&self.out)?;
        let slices = self.slices(set.manifest())?;
        let told = Told {
            place: output::shell(&self.out),
            gpu_memory: self.gpu_memory,
            slices: slices.is_some(),
        };
        let token = token()?;
        let viewer = Viewer::new(Shown { set, told, slices }, token.clone())?;
        let server = Server::bind(self.port)?;
        // from here on Ctrl-C is no interruption but the end
        stop::listen();
        let address = format!("{}/#{token}", server.address());
        output::print(&format!("{address}\n"))?;
        if !self.quiet {
            output::note("open this address in a browser of this machine; Ctrl-C ends it");
        }
        if !self.no_open {
            open_browser(&address);
        }
        let rules = Rules::new(server.port(), Vec::new());
        server.run(rules, viewer, stop::is_asked)?;
        Ok(Outcome::Done)
    }

    /// The volume that the tiles were made from, if it is given or found.
    fn slices(&self, manifest: &Manifest) -> Result<Option<Slices>> {
        if let Some(path) = &self.volume {
            return slices(&self.out, path, manifest).map(Some);
        }
        let beside = self.out.canonicalize().ok();
        let beside = beside.as_deref().and_then(Path::parent);
        let places = beside.into_iter().chain([Path::new("")]);
        let mut found = places.map(|place| place.join(&manifest.source.name));
        let found = found.find(|path| path.exists());
        let opened = found.and_then(|path| slices(&self.out, &path, manifest).ok());
        Ok(opened.filter(|slices| self.is_older(slices)))
    }

    /// True if a volume was written last before the tiles were: else it may be another one of this name.
    fn is_older(&self, slices: &Slices) -> bool {
        let made = self
            .out
            .join(MANIFEST)
            .metadata()
            .and_then(|m| m.modified());
        let written = slices.last_change();
        made.ok()
            .zip(written)
            .is_some_and(|(made, written)| written <= made)
    }
}

/// Slices of the volume at a path.
///
/// # Errors
/// [`Error::Usage`] if it is not the one that the tiles were made from, as far as size and type tell; those of opening
/// it.
fn slices(out: &Path, path: &Path, manifest: &Manifest) -> Result<Slices> {
    let asked = Asked {
        options: OpenOptions::default(),
        filters: &FilterArgs::default(),
        // what is outside of a region is shown as it is
        region: None,
        option: "--volume",
        progress: &Quiet,
    };
    let Against { volume, stamp, .. } = open_against(out, Input::Path(path), asked)?;
    let header = volume.header();
    if header.dims != manifest.grid.dims || header.dtype != manifest.filtered_dtype() {
        let found = format!(
            "{}: {} of {}",
            path.display(),
            header.dims,
            header.dtype.name()
        );
        let dtype = manifest.filtered_dtype();
        let expected = format!(
            "the volume of {} of {} that the tiles were made from",
            manifest.grid.dims,
            dtype.name()
        );
        return Err(Error::usage("--volume", found, expected));
    }
    Ok(Slices::new(volume, stamp))
}

/// Opens the address for the user. Whatever comes of it, the address was printed.
fn open_browser(address: &str) {
    let screen = ["DISPLAY", "WAYLAND_DISPLAY", "WSL_DISTRO_NAME"];
    // without a screen a browser of text would take the terminal
    if !cfg!(target_os = "linux") || screen.iter().any(|name| std::env::var_os(name).is_some()) {
        let _ = open::that_detached(address);
    }
}
