//! Triangle strips from a mesh whose triangle neighbours are known.
