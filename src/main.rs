//! The `alvis` command.

fn main() {}
