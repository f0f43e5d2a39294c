//! What objects are, and how well they reflect.

/// The class of an object or of the ground. The numbers stand in recordings (field `class`) and do not change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
#[allow(missing_docs)] // The names say it.
pub enum Class {
    Grass = 1,
    Litter = 2,
    Track = 3,
    Road = 4,
    Pavement = 5,
    Tree = 10,
    Bush = 11,
    Log = 12,
    Stump = 13,
    Undergrowth = 14,
    Rock = 15,
    Hedge = 16,
    Building = 20,
    Window = 21,
    Wall = 22,
    Fence = 23,
    Pole = 30,
    Sign = 31,
    Bin = 32,
    Bench = 33,
    Statue = 34,
    Car = 40,
    Van = 41,
    Person = 42,
    // What moves within a visit.
    MovingCar = 50,
    MovingVan = 51,
    Cyclist = 52,
    Walker = 53,
    Dog = 54,
}

impl Class {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 29] = {
        use Class::*;
        [
            Grass,
            Litter,
            Track,
            Road,
            Pavement,
            Tree,
            Bush,
            Log,
            Stump,
            Undergrowth,
            Rock,
            Hedge,
            Building,
            Window,
            Wall,
            Fence,
            Pole,
            Sign,
            Bin,
            Bench,
            Statue,
            Car,
            Van,
            Person,
            MovingCar,
            MovingVan,
            Cyclist,
            Walker,
            Dog,
        ]
    };

    /// The class of a number in a recording.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|c| *c as u8 == number)
    }

    /// Its name in lower case.
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Diffuse reflectivity at about 905 nm, 0 to 1. Vegetation, bark, brick, asphalt after the ASTER and ECOSTRESS
    /// spectral libraries (Meerdink et al., Remote Sensing of Environment 230, 2019), rounded; glass mirrors the beam away.
    pub fn reflectivity(self) -> f32 {
        match self {
            Self::Grass | Self::Bush | Self::Hedge | Self::Undergrowth => 0.45,
            Self::Litter => 0.35,
            Self::Track | Self::Rock | Self::Pavement => 0.3,
            Self::Road => 0.15,
            Self::Tree | Self::Log | Self::Stump | Self::Fence | Self::Bench => 0.4,
            Self::Building | Self::Wall | Self::Statue => 0.4,
            Self::Window => 0.06,
            Self::Pole | Self::Bin => 0.3,
            Self::Sign => 0.9,
            Self::Car | Self::Van | Self::MovingCar | Self::MovingVan => 0.35,
            Self::Person | Self::Walker | Self::Cyclist => 0.4,
            Self::Dog => 0.3,
        }
    }

    /// Whether it moves within a visit: its points lie where it was when the beam met it.
    pub fn moves(self) -> bool {
        matches!(self, Self::MovingCar | Self::MovingVan | Self::Cyclist | Self::Walker | Self::Dog)
    }

    /// Mean height of what grows or lies on the ground, metres: beams stop in it, early where they graze.
    pub fn cover(self) -> f32 {
        match self {
            Self::Grass => 0.035,
            Self::Litter => 0.04,
            Self::Track => 0.012,
            Self::Road | Self::Pavement => 0.002,
            _ => 0.0,
        }
    }
}
