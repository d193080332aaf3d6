//! Ctrl-C: the first one asks the work to stop where it can go on later, the second one ends the process.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

static ASKED: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// From now on the first SIGINT or SIGTERM raises a flag only. For work that looks at it: whatever else runs would
/// not be stopped by one.
pub fn listen() {
    // once: what would be registered again would take the first signal for the second one
    ASKED.get_or_init(|| {
        let asked = Arc::<AtomicBool>::default();
        for signal in [SIGINT, SIGTERM] {
            // without them a signal ends the process at once, as it does everywhere
            let _ = flag::register_conditional_default(signal, asked.clone())
                .and_then(|_| flag::register(signal, asked.clone()));
        }
        asked
    });
}

/// True once the user asked to stop.
pub fn is_asked() -> bool {
    ASKED
        .get()
        .is_some_and(|asked| asked.load(Ordering::Relaxed))
}
