//! Buffers for making tiles, shared by the threads under the limit of memory.

use crate::convert::memory::NEW_TILES;
use crate::error::Result;
use crate::strip::Stripifier;
use crate::surface::{TileMesh, TileMesher};
use crate::sys::locks::{lock, wait};
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

/// Everything that making one tile needs.
#[derive(Default)]
pub struct Workspace {
    /// Scratch of the mesher.
    pub mesher: TileMesher,
    /// The mesh.
    pub mesh: TileMesh,
    /// Makes strips of it.
    pub stripifier: Stripifier,
    /// The memory of all this.
    pub held: MemoryReservation,
}

/// Workspaces that wait for use.
pub struct WorkspacePool {
    memory: Arc<MemoryPool>,
    state: Mutex<State>,
    returned: Condvar,
}

#[derive(Default)]
struct State {
    idle: Vec<Workspace>,
    in_use: usize,
}

impl WorkspacePool {
    /// An empty pool.
    pub fn new(memory: &Arc<MemoryPool>) -> Self {
        WorkspacePool {
            memory: memory.clone(),
            state: Mutex::new(State::default()),
            returned: Condvar::new(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    /// Runs `work` with a workspace for a tile that needs `bytes` of buffers. Waits while there
    /// is no room and other tiles are being made.
    ///
    /// # Errors
    /// [`crate::Error::TooDense`] if there is no room even for this tile alone; what `work` returns.
    pub fn with<R>(&self, bytes: u64, work: impl FnOnce(&mut Workspace) -> Result<R>) -> Result<R> {
        let mut lent = self.take(bytes)?;
        let result = work(&mut lent.workspace);
        let Lent {
            workspace,
            returning,
        } = lent;
        self.lock().idle.push(workspace);
        drop(returning);
        result
    }

    /// Gives back the memory of workspaces that nobody uses. False if there is none.
    pub fn free_idle(&self) -> bool {
        let idle = std::mem::take(&mut self.lock().idle);
        !idle.is_empty()
    }

    fn take(&self, bytes: u64) -> Result<Lent<'_>> {
        let mut state = self.lock();
        loop {
            // the largest idle one has the least to grow
            state.idle.sort_by_key(|w| w.held.bytes());
            let mut workspace = state.idle.pop().unwrap_or_else(|| Workspace {
                held: MemoryReservation::new(&self.memory, NEW_TILES),
                ..Workspace::default()
            });
            let grown = workspace.held.grow_to(bytes);
            match grown {
                Ok(()) => {
                    state.in_use += 1;
                    let returning = Returning(self);
                    return Ok(Lent {
                        workspace,
                        returning,
                    });
                }
                Err(_) if !state.idle.is_empty() => state.idle.clear(),
                // nothing else to free: a fresh one holds least
                Err(_) if workspace.held.bytes() > 0 => drop(workspace),
                Err(_) if state.in_use > 0 => {
                    state = wait(&self.returned, state);
                }
                Err(error) => return Err(error),
            }
        }
    }
}

/// A workspace in use. If its user panics, it leaves memory before others hear of it.
struct Lent<'a> {
    workspace: Workspace,
    returning: Returning<'a>,
}

/// Tells those who wait that a workspace is no longer in use.
struct Returning<'a>(&'a WorkspacePool);

impl Drop for Returning<'_> {
    fn drop(&mut self) {
        self.0.lock().in_use -= 1;
        self.0.returned.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::memory::PROGRAM;

    #[test]
    fn a_tile_gets_the_room_of_one_that_panicked() {
        let pool = WorkspacePool::new(&MemoryPool::new(100, PROGRAM, 0));
        let (begun, begins) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            let panics = scope.spawn(|| {
                pool.with(60, |_| -> Result<()> {
                    begun.send(()).unwrap();
                    // the other one most likely waits by then
                    std::thread::sleep(std::time::Duration::from_millis(50));
                    panic!("as it should");
                })
            });
            begins.recv().unwrap();
            pool.with(60, |_| Ok(())).unwrap();
            assert!(panics.join().is_err());
        });
    }

    #[test]
    fn tiles_wait_for_room_and_fail_only_alone() {
        let pool = WorkspacePool::new(&MemoryPool::new(100, PROGRAM, 0));
        let done = std::sync::atomic::AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for i in 0..20 {
                let (pool, done) = (&pool, &done);
                scope.spawn(move || {
                    pool.with(30 + i % 60, |_| {
                        done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                        Ok(())
                    })
                    .unwrap();
                });
            }
        });
        assert_eq!(done.into_inner(), 20);
        assert!(pool.with(101, |_| Ok(())).is_err());
        assert!(pool.with(100, |_| Ok(())).is_ok());
    }
}
