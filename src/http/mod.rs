//! A blocking HTTP/1.1 server for one user on this machine.
//!
//! It listens on the loopback addresses alone. That does not keep web pages out, which may give their own name the
//! address 127.0.0.1: so each request is looked at before anything else is done with it (`rules`), and every answer
//! says what pages may do with it (`answer`). Requests have no body. A connection has a thread, of which there are
//! [`server::CONNECTIONS`] at most, so that a slow one keeps nobody else waiting; [`Turns`] bounds what is worked on.

mod answer;
mod request;
mod rules;
mod server;
mod turns;

pub use answer::{Answer, Body, Status};
pub use request::{Method, Request};
pub use rules::{Rules, same_secret};
pub use server::{Client, Handler, Server};
pub use turns::Turns;
