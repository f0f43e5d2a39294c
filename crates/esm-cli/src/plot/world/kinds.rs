//! What is drawn in which colour.

use esm_sim::Class;

/// Things that look alike in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kind {
    /// For the legend.
    pub(super) label: &'static str,
    /// Red, green, blue.
    pub(super) rgb: [u8; 3],
    /// Whether it is ground.
    pub(super) ground: bool,
}

const fn kind(label: &'static str, rgb: [u8; 3], ground: bool) -> Kind {
    Kind { label, rgb, ground }
}

/// All of them, in the legend's order.
pub(super) const KINDS: [Kind; 16] = [
    kind("grass", [158, 178, 116], true),
    kind("leaf litter", [173, 154, 118], true),
    kind("track", [214, 198, 164], true),
    kind("road", [146, 148, 152], true),
    kind("pavement", [196, 194, 190], true),
    kind("trees", [62, 128, 62], false),
    kind("bushes, hedges", [118, 168, 52], false),
    kind("undergrowth, logs", [150, 116, 60], false),
    kind("rocks", [128, 124, 132], false),
    kind("buildings", [188, 110, 84], false),
    kind("windows", [96, 136, 172], false),
    kind("walls, fences", [208, 158, 96], false),
    kind("poles, signs", [232, 196, 40], false),
    kind("benches, bins, statues", [214, 96, 160], false),
    kind("vehicles", [66, 112, 206], false),
    kind("people, cyclists, dogs", [226, 62, 52], false),
];

/// The place of a class in [`KINDS`].
pub(super) fn kind_of(class: Class) -> usize {
    match class {
        Class::Grass => 0,
        Class::Litter => 1,
        Class::Track => 2,
        Class::Road => 3,
        Class::Pavement => 4,
        Class::Tree => 5,
        Class::Bush | Class::Hedge => 6,
        Class::Log | Class::Stump | Class::Undergrowth => 7,
        Class::Rock => 8,
        Class::Building => 9,
        Class::Window => 10,
        Class::Wall | Class::Fence => 11,
        Class::Pole | Class::Sign => 12,
        Class::Bench | Class::Bin | Class::Statue => 13,
        Class::Car | Class::Van | Class::MovingCar | Class::MovingVan => 14,
        _ => 15,
    }
}
