//! Random streams, each with a name.
//!
//! Whatever draws random numbers in a search, or while constants are tuned, draws from a
//! stream of its own, named by (seed, island, generation, index). The name is the key of a ChaCha
//! cipher, all 256 bits of it, so that different names give unrelated streams,
//! in any order and on any thread; nothing has to be carried from one
//! generation to the next, and a resumed search draws what it would have drawn.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// A stream of random numbers.
pub type Stream = ChaCha8Rng;

/// The stream of one individual-to-be: place `index` on an island in a generation. Tuning has
/// steps for generations, and image parts for individuals.
pub fn stream(seed: u64, island: usize, generation: u32, index: usize) -> Stream {
    let name = [seed, island as u64, u64::from(generation), index as u64];
    let mut key = [0; 32];
    for (bytes, word) in key.chunks_exact_mut(8).zip(name) {
        bytes.copy_from_slice(&word.to_le_bytes());
    }
    Stream::from_seed(key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn every_part_of_the_name_counts() {
        let first =
            |seed, island, generation, index| stream(seed, island, generation, index).next_u64();
        let draws = [
            first(0, 0, 0, 0),
            first(1, 0, 0, 0),
            first(0, 1, 0, 0),
            first(0, 0, 1, 0),
            first(0, 0, 0, 1),
        ];
        for (k, draw) in draws.iter().enumerate() {
            assert!(!draws[..k].contains(draw), "name {k} repeats an earlier stream");
        }
        assert_eq!(first(0, 0, 0, 1), draws[4]);
    }
}
