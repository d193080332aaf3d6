//! Volumes to convert, and the sets that are made of them.

use crate::run::{self, Alvis, Sample};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A volume on disk.
pub struct Input {
    /// What it shows.
    pub what: &'static str,
    pub path: PathBuf,
    pub dims: [u32; 3],
    pub dtype: &'static str,
    pub threshold: f64,
}

impl Input {
    pub fn voxels(&self) -> f64 {
        self.dims.iter().map(|&n| f64::from(n)).product()
    }

    pub fn name(&self) -> String {
        let [x, y, z] = self.dims;
        format!("{}, {x} x {y} x {z} {}", self.what, self.dtype)
    }

    /// Makes a phantom of this kind, unless a file of that size is there.
    pub fn phantom(
        dir: &Path,
        what: &'static str,
        dims: [u32; 3],
        dtype: &'static str,
    ) -> Result<Input, String> {
        let [x, y, z] = dims;
        let path = dir.join(format!("{what}_{x}x{y}x{z}_{dtype}.raw"));
        let (bytes, threshold) = match dtype {
            "u8" => (1, 127.5),
            "u16" => (2, 32_767.5),
            "i16" => (2, -0.5),
            "f32" => (4, 0.5),
            _ => return Err(format!("no phantoms of {dtype} here")),
        };
        let input = Input {
            what,
            path,
            dims,
            dtype,
            threshold,
        };
        let size = input.voxels() as u64 * bytes;
        if std::fs::metadata(&input.path).map_or(0, |m| m.len()) != size {
            let text = format!("{x},{y},{z}");
            let path = input.path.display().to_string();
            let args = ["phantom", what, &path, "--dims", &text, "--dtype", dtype];
            run::timed(Alvis::command(
                &[&args[..], &["--force", "--quiet"]].concat(),
            )?)?;
        }
        Ok(input)
    }

    /// Converts into a new set.
    pub fn convert(&self, sets: &mut Sets, more: &[&str]) -> Result<Sample, String> {
        self.prepare(sets)?;
        run::timed(Alvis::command(&self.words(&sets.fresh(), more))?)
    }

    /// The same on one core: the threads that write beside those that make tiles share it, too.
    pub fn convert_on_one_core(&self, sets: &mut Sets) -> Result<Sample, String> {
        self.prepare(sets)?;
        run::timed(Alvis::command_on_one_core(&self.words(&sets.fresh(), &[]))?)
    }

    /// As many conversions of one thread each as there are cores, at once; seconds until all are done.
    ///
    /// They share nothing but the machine: what it gives to them is what threads of one can expect of it.
    pub fn convert_side_by_side(&self, sets: &mut Sets) -> Result<f64, String> {
        self.prepare(sets)?;
        let commands: Vec<Command> = (0..run::cores())
            .map(|_| Alvis::command(&self.words(&sets.fresh(), &["--threads", "1"])))
            .collect::<Result<_, _>>()?;
        run::timed_at_once(commands)
    }

    /// Makes all conversions begin alike: those before have nothing left to be written, nor has the volume, which is
    /// read once, since others may have driven it out of the file cache: large ones would be measured from the disk,
    /// small ones not.
    fn prepare(&self, sets: &mut Sets) -> Result<(), String> {
        sets.empty()?;
        std::fs::File::open(&self.path)
            .and_then(|mut file| {
                file.sync_all()?;
                std::io::copy(&mut file, &mut std::io::sink())
            })
            .map_err(|e| format!("{}: {e}", self.path.display()))?;
        Ok(())
    }

    fn words(&self, out: &Path, more: &[&str]) -> Vec<String> {
        let [x, y, z] = self.dims;
        let (dims, threshold) = (format!("{x},{y},{z}"), self.threshold.to_string());
        let (input, out) = (self.path.display().to_string(), out.display().to_string());
        let args = [
            "convert",
            &input,
            &out,
            "--dims",
            &dims,
            "--dtype",
            self.dtype,
            "--threshold",
            &threshold,
            "--json",
            "--quiet",
        ];
        args.iter().chain(more).map(|&word| word.into()).collect()
    }
}

/// Sets that conversions have made, each in a directory of its own: replacing one is no part of a conversion, and
/// ext4 looks long for room for a file right after others were deleted (half a conversion of thousands of small
/// tiles), so they are deleted in the end.
pub struct Sets {
    dir: PathBuf,
    count: usize,
    emptied: usize,
}

impl Sets {
    /// In this directory, which may hold those of a run that did not come to its end.
    pub fn new(dir: PathBuf) -> Result<Sets, String> {
        let count = std::fs::create_dir_all(&dir)
            .and_then(|()| Ok(std::fs::read_dir(&dir)?.count()))
            .map_err(|e| format!("{}: {e}", dir.display()))?;
        Ok(Sets {
            dir,
            count,
            emptied: 0,
        })
    }

    fn path(&self, number: usize) -> PathBuf {
        self.dir.join(number.to_string())
    }

    fn fresh(&mut self) -> PathBuf {
        self.count += 1;
        self.path(self.count - 1)
    }

    /// The one that was made last.
    pub fn last(&self) -> String {
        self.path(self.count - 1).display().to_string()
    }

    /// Gives back the room on disk that their files take, and waits until the system is done with that. The names
    /// stay.
    ///
    /// Else it may write them to the disk while others are made, and take time from whichever of them it meets.
    pub fn empty(&mut self) -> Result<(), String> {
        fn each(dir: &Path) -> std::io::Result<()> {
            for entry in std::fs::read_dir(dir)? {
                let entry = entry?;
                if entry.file_type()?.is_dir() {
                    each(&entry.path())?;
                } else {
                    std::fs::File::create(entry.path())?;
                }
            }
            Ok(())
        }
        if self.emptied == self.count {
            return Ok(());
        }
        while self.emptied < self.count {
            let set = self.path(self.emptied);
            each(&set).map_err(|e| format!("{}: {e}", set.display()))?;
            self.emptied += 1;
        }
        std::thread::sleep(std::time::Duration::from_secs(1));
        Ok(())
    }

    /// Deletes all.
    pub fn delete(self) -> Result<(), String> {
        std::fs::remove_dir_all(&self.dir).map_err(|e| format!("{}: {e}", self.dir.display()))
    }
}
