//! A [`Map`]'s points: verified before their first use, decoded on demand.

use super::container::{Map, Origin};
use super::problem::Problem;
use super::quantise;
use super::records::PointRun;
use crate::error::Error;

impl Map {
    /// One segment's points, metres, relative to the origin.
    ///
    /// # Errors
    /// [`Error::MapFile`] where a block that holds them is damaged; [`Error::MapData`] where there is no such segment.
    pub fn segment_points(&self, segment: usize) -> Result<Vec<[f32; 3]>, Error> {
        let mut points = Vec::new();
        self.segment_points_into(segment, &mut points)?;
        Ok(points)
    }

    /// As [`segment_points`](Self::segment_points), replacing the contents of `points`.
    ///
    /// # Errors
    /// As [`segment_points`](Self::segment_points).
    pub fn segment_points_into(&self, segment: usize, points: &mut Vec<[f32; 3]>) -> Result<(), Error> {
        self.run_points(self.runs(), "segment", segment, points)
    }

    /// One ground tile's points, metres, relative to the origin, replacing the contents of `points`.
    ///
    /// # Errors
    /// As [`segment_points`](Self::segment_points).
    pub fn ground_tile_points_into(&self, tile: usize, points: &mut Vec<[f32; 3]>) -> Result<(), Error> {
        self.run_points(self.ground_tiles(), "ground tile", tile, points)
    }

    /// One structure tile's points, metres, relative to the origin, replacing the contents of `points`.
    ///
    /// # Errors
    /// As [`segment_points`](Self::segment_points).
    pub fn structure_tile_points_into(&self, tile: usize, points: &mut Vec<[f32; 3]>) -> Result<(), Error> {
        self.run_points(self.structure_tiles(), "structure tile", tile, points)
    }

    /// Verifies all point blocks not yet verified, on all threads. Nothing to do for a map in memory.
    ///
    /// # Errors
    /// [`Error::MapFile`] that names the first damaged block and says how many there are.
    pub fn verify_points(&self) -> Result<(), Error> {
        match &self.origin_of {
            Origin::Memory => Ok(()),
            Origin::File { path, blocks, .. } => blocks.verify_all().map_err(|p| p.in_file(path)),
        }
    }

    fn run_points(
        &self,
        runs: &[PointRun],
        kind: &str,
        index: usize,
        points: &mut Vec<[f32; 3]>,
    ) -> Result<(), Error> {
        let run = *runs.get(index).ok_or_else(|| Error::MapData {
            what: format!("{kind} {index} was asked for, there are {}", runs.len()),
            hint: "this is an error of the program that uses the map",
        })?;
        // Checked when the map was made, and again here: a mapped file may have been edited since.
        let range = usize::try_from(run.start).ok().and_then(|s| Some(s..s.checked_add(run.len as usize)?));
        let stored = range.clone().and_then(|r| self.points.get(r));
        let (Some(range), Some(stored)) = (range, stored) else {
            return Err(self.problem(Problem::damaged(format!(
                "the point run of {kind} {index} has changed since the file was opened"
            ))));
        };
        let row = size_of::<[u16; 3]>();
        if let Origin::File { blocks, .. } = &self.origin_of {
            blocks.verify(range.start * row..range.end * row).map_err(|p| self.problem(p))?;
        }
        quantise::decode(&run, stored, points);
        Ok(())
    }

    fn problem(&self, problem: Problem) -> Error {
        match &self.origin_of {
            Origin::Memory => problem.in_data(),
            Origin::File { path, .. } => problem.in_file(path),
        }
    }
}
