//! Other drives of the second visit: the other way round, beside the mapped way, after more has changed.

use crate::error::Error;
use crate::preset::Preset;

/// Metres beside the mapped way, at most.
pub(crate) const MOST_ASIDE_M: f64 = 20.0;

/// How the live visit differs from a preset's own. The map visit is the same to the byte whatever is asked for here.
///
/// ```
/// use esm_sim::{Drive, preset};
/// let kitti = preset("kitti")?;
/// let drive = Drive { reversed: true, offset_m: 2.0, changed: Some(0.3) };
/// let other = drive.of(&kitti)?;
/// assert_eq!((other.map, other.live.offset_m, other.live.visit.changed), (kitti.map, 2.0, Some(0.3)));
/// assert_eq!(Drive::default().of(&kitti)?, kitti);
/// assert!(Drive { offset_m: 100.0, ..Drive::default() }.of(&kitti).is_err());
/// # Ok::<(), esm_sim::Error>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drive {
    /// The same stretch, from its end to its start. Where cars keep to the right they do so then too.
    pub reversed: bool,
    /// Metres beside the way, to the left as it is driven; negative to the right. As much of that as the ground allows (see
    /// [`Tour::way`](crate::Tour::way)); -20 to 20.
    pub offset_m: f64,
    /// The share (0 to 1) of what can change that differs between the visits (see
    /// [`Visit::changed`](crate::Visit::changed)); `None` leaves what the preset has.
    pub changed: Option<f64>,
}

impl Drive {
    /// A preset whose live visit is driven so.
    ///
    /// # Errors
    /// [`Error::Offset`], [`Error::Changed`].
    pub fn of(&self, preset: &Preset) -> Result<Preset, Error> {
        let mut driven = *preset;
        let live = &mut driven.live;
        if !(-MOST_ASIDE_M..=MOST_ASIDE_M).contains(&self.offset_m) {
            return Err(Error::Offset { offset_m: self.offset_m, most_m: MOST_ASIDE_M });
        }
        if let Some(share) = self.changed.filter(|share| !(0.0..=1.0).contains(share)) {
            return Err(Error::Changed { share });
        }
        if self.reversed {
            // Parts are told as they are driven.
            let (from, to) = live.part;
            (live.reversed, live.part) = (!live.reversed, (1.0 - to, 1.0 - from));
        }
        live.offset_m += self.offset_m;
        live.visit.changed = self.changed.or(live.visit.changed);
        Ok(driven)
    }
}
