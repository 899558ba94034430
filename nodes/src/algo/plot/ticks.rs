//! Round numbers along an axis.

/// Round numbers within a range, and how they are written.
#[derive(Clone, Debug, PartialEq)]
pub struct Ticks {
    /// The numbers, from the least.
    pub at: Vec<f64>,
    /// One text for each.
    pub labels: Vec<String>,
}

/// At most `most` + 1 multiples of 1, 2 or 5 times a power of ten within `low` to `high`, at least `least_step` apart.
///
/// Without an interval (ends that are not finite, or crossed) there are none. Labels have as many decimals as the step asks for; numbers of a
/// million or more and of less than a ten thousandth are written with a power of ten.
pub fn ticks(low: f64, high: f64, most: usize, least_step: f64) -> Ticks {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) {
        return Ticks { at: Vec::new(), labels: Vec::new() };
    }
    let step = nice_step(span / most.max(1) as f64).max(least_step);
    let slack = 1e-9 * span;
    let first = libm::ceil((low - slack) / step);
    let count = libm::floor((high + slack) / step) - first;
    let at: Vec<f64> = (0..=count.clamp(-1.0, 1e4) as i64).map(|i| (first + i as f64) * step).filter(|_| count >= 0.0).collect();
    let power = common_power(low.abs().max(high.abs()));
    let unit = libm::pow(10.0, power);
    let decimals = (-libm::floor(libm::log10(step / unit) + 1e-9)).clamp(0.0, 12.0) as usize;
    let labels = at.iter().map(|&v| label(v / unit, decimals, power)).collect();
    Ticks { at, labels }
}

/// The least of 1, 2 and 5 times a power of ten that is not below `raw`.
fn nice_step(raw: f64) -> f64 {
    let power = libm::pow(10.0, libm::floor(libm::log10(raw)));
    let fraction = raw / power;
    let nice = [1.0, 2.0, 5.0].into_iter().find(|n| fraction <= n * (1.0 + 1e-9)).unwrap_or(10.0);
    nice * power
}

/// The power of ten that is taken out of all labels of an axis whose largest number is `largest`; 0 for numbers that are easily read.
fn common_power(largest: f64) -> f64 {
    if (1e-3..1e6).contains(&largest) || largest == 0.0 { 0.0 } else { libm::floor(libm::log10(largest)) }
}

fn label(value: f64, decimals: usize, power: f64) -> String {
    let text = format!("{value:.decimals$}");
    // A rounded nought has no sign, and a minus is as wide as a plus.
    let is_nought = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
    let text = if is_nought { text.trim_start_matches('-').to_owned() } else { text.replace('-', "−") };
    match power as i64 {
        0 => text,
        _ if is_nought => "0".to_owned(),
        p => format!("{text}e{p}").replace("e-", "e−"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, most: usize) -> Vec<String> {
        ticks(low, high, most, 0.0).labels
    }

    #[test]
    fn ticks_are_multiples_of_one_two_or_five() {
        assert_eq!(labels(0.0, 10.0, 5), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels(-0.3, 0.31, 4), ["−0.2", "0.0", "0.2"]);
        assert_eq!(labels(0.98, 1.03, 5), ["0.98", "0.99", "1.00", "1.01", "1.02", "1.03"]);
        assert_eq!(labels(1.0, 96.0, 5), ["20", "40", "60", "80"]);
        assert_eq!(labels(0.0, 3e6, 3), ["0", "1e6", "2e6", "3e6"]);
        assert_eq!(labels(-2e-5, 1e-5, 3), ["−2e−5", "−1e−5", "0", "1e−5"]);
    }

    #[test]
    fn ticks_are_never_many_and_always_inside() {
        for i in 1..400 {
            let (low, high) = (-0.37 * f64::from(i), libm::exp(f64::from(i % 37) - 9.0));
            let ticks = ticks(low, high, 6, 0.0);
            assert!((3..=7).contains(&ticks.at.len()), "{low} to {high}: {ticks:?}");
            assert!(ticks.at.iter().all(|v| *v >= low - 1e-6 * (high - low) && *v <= high + 1e-6 * (high - low)));
            assert!(ticks.labels.windows(2).all(|l| l[0] != l[1]), "{low} to {high}: {ticks:?}");
        }
    }

    #[test]
    fn frames_are_whole_and_nothing_has_no_ticks() {
        assert_eq!(ticks(1.0, 3.0, 8, 1.0).labels, ["1", "2", "3"]);
        for (low, high) in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY), (f64::MIN, f64::MAX)] {
            assert!(ticks(low, high, 5, 0.0).at.is_empty());
        }
    }
}
