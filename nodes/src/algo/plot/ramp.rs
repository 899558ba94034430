//! Ramps of colour for magnitudes.

use pegbar_engine::Setting;

use super::super::color::linear_from_srgb;
use super::super::paint::hex;

/// Which colours stand for less and more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum Ramp {
    /// Dark violet over green to yellow: even steps to the eye, with any kind of sight and in print.
    #[default]
    Viridis,
    /// Black to white.
    Gray,
}

/// Every eighth colour of viridis, and the last; straight lines between them are within two 255ths of the others.
///
/// Smith, van der Walt, Firing, *viridis*, 2015 (matplotlib, CC0).
const VIRIDIS: [u32; 33] = [
    0x440154, 0x470D60, 0x48186A, 0x482374, 0x472D7B, 0x453681, 0x424086, 0x3F4989, 0x3B528B, 0x375A8D, 0x33638D, 0x2F6A8E, 0x2C728E,
    0x297A8E, 0x26818E, 0x23898E, 0x21908C, 0x1F988B, 0x1F9F88, 0x21A685, 0x28AE80, 0x31B57B, 0x3EBC74, 0x4CC26C, 0x5DC963, 0x6ECE58,
    0x82D34C, 0x96D83F, 0xABDC32, 0xC0DF24, 0xD5E21A, 0xEAE51A, 0xFDE725,
];

impl Ramp {
    /// The colour at `share` of the way, 0 to 1, ends held: linear light, opaque; that of [`Self::nothing`] where it is NaN.
    pub fn at(self, share: f64) -> [f32; 4] {
        if share.is_nan() {
            return self.nothing();
        }
        let share = share.clamp(0.0, 1.0);
        match self {
            Self::Gray => {
                let v = linear_from_srgb(share) as f32;
                [v, v, v, 1.0]
            }
            Self::Viridis => {
                let place = share * (VIRIDIS.len() - 1) as f64;
                let first = (place as usize).min(VIRIDIS.len() - 2);
                let rest = place - first as f64;
                let channel = |colour: u32, shift: u32| f64::from((colour >> shift) & 255) / 255.0;
                let mixed = |shift: u32| {
                    let (a, b) = (channel(VIRIDIS[first], shift), channel(VIRIDIS[first + 1], shift));
                    linear_from_srgb(a + (b - a) * rest) as f32
                };
                [mixed(16), mixed(8), mixed(0), 1.0]
            }
        }
    }

    /// A colour that is nowhere on the ramp.
    pub fn nothing(self) -> [f32; 4] {
        match self {
            Self::Viridis => hex(0x9E_9E_9E),
            Self::Gray => hex(0xE8_B4_B4),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viridis_is_that_of_matplotlib() {
        // Entries 0, 64, 127, 200 and 255 of matplotlib 3.
        let truth = [
            (0.0, [0.267004, 0.004874, 0.329415]),
            (64.0, [0.229739, 0.322361, 0.545706]),
            (127.0, [0.128729, 0.563265, 0.551229]),
            (200.0, [0.440137, 0.811138, 0.340967]),
            (255.0, [0.993248, 0.906157, 0.143936]),
        ];
        for (entry, colour) in truth {
            let found = Ramp::Viridis.at(entry / 255.0);
            for (found, truth) in found.iter().zip(colour) {
                assert!((f64::from(*found) - linear_from_srgb(truth)).abs() < 0.01, "entry {entry}: expected {truth}, found {found}");
            }
        }
    }

    #[test]
    fn ends_are_held_and_nothing_has_a_colour_of_its_own() {
        for ramp in [Ramp::Viridis, Ramp::Gray] {
            assert_eq!((ramp.at(-3.0), ramp.at(7.0)), (ramp.at(0.0), ramp.at(1.0)));
            let light = |share: f64| ramp.at(share).iter().sum::<f32>();
            assert_eq!(ramp.at(f64::NAN), ramp.nothing());
            assert!((0..20).all(|k| light(f64::from(k) / 20.0) < light(f64::from(k + 1) / 20.0)), "{ramp:?} rises");
        }
    }
}
