//! `alvis view` and `alvis serve`, asked over sockets as browsers ask, and as nobody should.

#[path = "../command/mod.rs"]
mod command;

mod client;
mod data;
mod files;
mod levels;
mod life;
mod safety;
