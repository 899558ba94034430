//! Orders of events to look at.

use shuttle::scheduler::{PctScheduler, RandomScheduler, UrwRandomScheduler};
use shuttle::{Config, Runner};

/// How much more than by default; set it for a long look.
fn more() -> usize {
    std::env::var("PEGBAR_ORDERS").ok().and_then(|n| n.parse().ok()).unwrap_or(1)
}

/// Runs `check` under so many orders: threads picked at random at each step, threads with random priorities that change a few times, and orders
/// that are all as likely.
pub(crate) fn orders(n: usize, check: impl Fn() + Send + Sync + Clone + 'static) {
    let n = n * more();
    let config = || {
        let mut config = Config::default();
        config.silence_warnings = true;
        config.stack_size = 1 << 18;
        config
    };
    Runner::new(RandomScheduler::new_from_seed(1, n), config()).run(check.clone());
    for depth in 2..=4 {
        Runner::new(PctScheduler::new_from_seed(depth as u64, depth, n / 3 + 1), config()).run(check.clone());
    }
    Runner::new(UrwRandomScheduler::new_from_seed(1, n), config()).run(check);
}
