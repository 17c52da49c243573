//! Who stays, and who becomes a parent.
//!
//! Programs are compared by three goals at once: error, run time and size. Who stays is said
//! by non-dominated sorting and crowding (NSGA-II: Deb, Pratap, Agarwal, Meyarivan, 2002).
//! Parents are chosen by ε-lexicase selection over the scenes (La Cava, Spector, Danai, 2016):
//! a random scene after another leaves only those that are about the best there, so that a
//! program that is best somewhere has children, however it does on average.

use rand::RngExt;
use rand::seq::SliceRandom;

use crate::tune::Stream;

/// What is made small: error, cost, size.
pub type Goals = [f64; 3];

/// Whether one is nowhere worse than another, and better somewhere.
pub fn dominates(a: &Goals, b: &Goals) -> bool {
    a.iter().zip(b).all(|(a, b)| a <= b) && a.iter().zip(b).any(|(a, b)| a < b)
}

/// How many fronts have to be taken away until nobody is better than each: 0 for the front.
pub fn ranks(goals: &[Goals]) -> Vec<usize> {
    let mut ranks = vec![usize::MAX; goals.len()];
    let mut left: Vec<usize> = (0..goals.len()).collect();
    let mut rank = 0;
    while !left.is_empty() {
        let is_front = |&k: &usize| !left.iter().any(|&other| dominates(&goals[other], &goals[k]));
        let front: Vec<usize> = left.iter().copied().filter(is_front).collect();
        for &k in &front {
            ranks[k] = rank;
        }
        left.retain(|&k| ranks[k] == usize::MAX);
        rank += 1;
    }
    ranks
}

/// How much room each has among those of its rank: the sum over the goals of the distance
/// between its neighbours, as a share of the whole; infinite at the ends.
pub fn crowding(goals: &[Goals], ranks: &[usize]) -> Vec<f64> {
    let mut room = vec![0.0; goals.len()];
    let last = ranks.iter().copied().max().unwrap_or(0);
    for rank in 0..=last {
        let members: Vec<usize> = (0..goals.len()).filter(|&k| ranks[k] == rank).collect();
        let by: [fn(&Goals) -> f64; 3] = [|g| g[0], |g| g[1], |g| g[2]];
        for goal in by {
            let value = |k: usize| goal(&goals[k]);
            let mut order = members.clone();
            order.sort_by(|&a, &b| value(a).total_cmp(&value(b)).then(a.cmp(&b)));
            let (Some(&low), Some(&high)) = (order.first(), order.last()) else { continue };
            let whole = value(high) - value(low);
            room[low] = f64::INFINITY;
            room[high] = f64::INFINITY;
            if whole > 0.0 {
                for three in order.windows(3) {
                    room[three[1]] += (value(three[2]) - value(three[0])) / whole;
                }
            }
        }
    }
    room
}

/// The `count` that stay, in their order: by rank, and of one rank those with the most room.
pub fn survivors(goals: &[Goals], count: usize) -> Vec<usize> {
    let ranks = ranks(goals);
    let room = crowding(goals, &ranks);
    let mut order: Vec<usize> = (0..goals.len()).collect();
    order.sort_by(|&a, &b| {
        ranks[a].cmp(&ranks[b]).then(room[b].total_cmp(&room[a])).then(a.cmp(&b))
    });
    order.truncate(count);
    order.sort_unstable();
    order
}

/// A parent, by ε-lexicase selection over `cases`: per candidate as many errors as there are
/// scenes. ε is the median of the absolute deviations from the median, scene by scene.
pub fn lexicase(cases: &[&[f64]], rng: &mut Stream) -> usize {
    let scenes = cases.first().map_or(0, |errors| errors.len());
    let mut order: Vec<usize> = (0..scenes).collect();
    order.shuffle(rng);
    let mut left: Vec<usize> = (0..cases.len()).collect();
    for scene in order {
        if left.len() == 1 {
            break;
        }
        let mut errors: Vec<f64> = left.iter().map(|&k| cases[k][scene]).collect();
        errors.sort_by(f64::total_cmp);
        let best = errors[0];
        let median = errors[errors.len() / 2];
        let mut deviations: Vec<f64> = errors.iter().map(|x| (x - median).abs()).collect();
        deviations.sort_by(f64::total_cmp);
        let epsilon = deviations[deviations.len() / 2];
        left.retain(|&k| cases[k][scene] <= best + epsilon);
    }
    left[rng.random_range(0..left.len())]
}

/// A parent, by a tournament of two: the better rank, and of one rank the one with more room.
pub fn tournament(ranks: &[usize], room: &[f64], rng: &mut Stream) -> usize {
    let [a, b] = [(); 2].map(|()| rng.random_range(0..ranks.len()));
    match ranks[a].cmp(&ranks[b]).then(room[b].total_cmp(&room[a])) {
        std::cmp::Ordering::Greater => b,
        _ => a,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::stream;

    const GOALS: [Goals; 5] =
        [[1.0, 5.0, 5.0], [2.0, 4.0, 5.0], [3.0, 4.5, 5.0], [4.0, 1.0, 5.0], [4.0, 5.0, 6.0]];

    #[test]
    fn fronts_are_what_nobody_is_better_than() {
        assert_eq!(ranks(&GOALS), [0, 0, 1, 0, 2]);
        assert!(!dominates(&GOALS[0], &GOALS[0]));
    }

    #[test]
    fn the_best_by_each_goal_stay_and_then_who_has_room() {
        assert_eq!(survivors(&GOALS, 2), [0, 3]);
        assert_eq!(survivors(&GOALS, 4), [0, 1, 2, 3]);
        // Two close to each other: one of them goes.
        let line: Vec<Goals> = [0.0, 1.0, 1.1, 3.0].iter().map(|&x| [x, 3.0 - x, 1.0]).collect();
        assert_eq!(survivors(&line, 3).len(), 3);
        assert!(survivors(&line, 3).contains(&0) && survivors(&line, 3).contains(&3));
    }

    #[test]
    fn whoever_is_best_on_a_scene_becomes_a_parent() {
        // The third is best on average and nowhere by itself; the fourth is bad everywhere.
        let cases: [&[f64]; 4] = [&[0.0, 9.0], &[9.0, 0.0], &[1.0, 1.0], &[9.0, 9.0]];
        let mut chosen = [0; 4];
        for k in 0..400 {
            chosen[lexicase(&cases, &mut stream(1, 0, 0, k))] += 1;
        }
        assert!(chosen[0] > 50 && chosen[1] > 50, "{chosen:?}");
        assert_eq!(chosen[3], 0);
    }
}
