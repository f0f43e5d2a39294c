//! Requests and their answers.

mod guard;
mod health;
mod localize;
mod log;
mod maps;
pub(crate) mod routes;

pub(crate) use localize::bad_query;
pub(crate) use log::REQUEST_ID;
pub(crate) use routes::router;
