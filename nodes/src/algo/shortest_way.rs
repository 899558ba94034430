//! The cheapest way through a net (Dijkstra, *A note on two problems in connexion with graphs*, 1959).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A point on the front, cheapest first; of equal ones the lower number.
#[derive(PartialEq)]
struct Open {
    cost: f64,
    at: usize,
}

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.at.cmp(&self.at))
    }
}

/// The points of the cheapest way between two of `n` points, both ends with it; `None` where there is none. `steps` tells each step that leads from a
/// point: where to, and its cost, not below nought. Cost: O(steps log steps).
pub fn shortest_way(n: usize, [from, to]: [usize; 2], mut steps: impl FnMut(usize, &mut dyn FnMut(usize, f64))) -> Option<Vec<usize>> {
    let mut known = vec![(f64::INFINITY, usize::MAX); n];
    let mut open = BinaryHeap::from([Open { cost: 0.0, at: from }]);
    known[from].0 = 0.0;
    while let Some(Open { cost, at }) = open.pop() {
        if at == to {
            break;
        }
        if cost > known[at].0 {
            continue;
        }
        steps(at, &mut |next, step| {
            if cost + step < known[next].0 {
                known[next] = (cost + step, at);
                open.push(Open { cost: cost + step, at: next });
            }
        });
    }
    if known[to].0 == f64::INFINITY {
        return None;
    }
    let before = |at: &usize| Some(known[*at].1).filter(|_| *at != from);
    let mut way: Vec<usize> = std::iter::successors(Some(to), before).collect();
    way.reverse();
    Some(way)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cheapest_way_is_found_and_none_where_there_is_none() {
        // Round by 1 and 2 costs 3, straight to 3 costs 4; nothing leads to 4.
        let steps = [vec![(1, 1.0), (3, 4.0)], vec![(2, 1.0)], vec![(3, 1.0), (0, 0.0)], vec![], vec![(0, 1.0)]];
        let way = |ends| shortest_way(5, ends, |at, step| steps[at].iter().for_each(|(next, cost)| step(*next, *cost)));
        assert_eq!(way([0, 3]), Some(vec![0, 1, 2, 3]));
        assert_eq!(way([0, 0]), Some(vec![0]));
        assert_eq!(way([0, 4]), None);
    }

    #[test]
    fn of_equal_ways_the_lower_number_is_taken() {
        let steps = [vec![(2, 1.0), (1, 1.0)], vec![(3, 1.0)], vec![(3, 1.0)], vec![]];
        assert_eq!(shortest_way(4, [0, 3], |at, step| steps[at].iter().for_each(|(next, cost)| step(*next, *cost))), Some(vec![0, 1, 3]));
    }
}
