//! Requests and their answers.

mod events;
mod guard;
mod health;
mod localize;
mod log;
mod maps;
mod page;
mod points;
pub(crate) mod routes;

pub(crate) use localize::bad_query;
pub(crate) use log::REQUEST_ID;
pub(crate) use routes::router;
