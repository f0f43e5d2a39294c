//! What a segment shows, by name.

use esm_learn::{Found, Identities, PointLabel};
use esm_sim::Class;

/// The name of what a segment shows, the same in all visits; negative where that cannot be said. `numbered` where the points
/// of the recording carry the numbers of their objects; otherwise segments are named by where they are.
pub fn object_of(found: &Found, numbered: bool, names: &mut Identities) -> i64 {
    match (found.label, numbered) {
        // The ground, and what does not stay where it is, is nothing to find again.
        (Some(label), true) if label.object != 0 && !moves(label) => {
            names.of(label.object, found.centroid_map)
        }
        (_, true) => -1,
        (_, false) => names.of(0, found.centroid_map),
    }
}

fn moves(label: PointLabel) -> bool {
    Class::from_number(label.class).is_some_and(Class::moves)
}
