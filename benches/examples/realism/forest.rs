use crate::figures::Table;
pub(crate) fn table(
    _s: &std::path::Path,
    _seed: u64,
    _w: &std::path::Path,
) -> Result<Table, Box<dyn std::error::Error>> {
    Err("todo".into())
}
