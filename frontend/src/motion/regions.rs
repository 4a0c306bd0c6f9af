//! From the votes of single cells to the objects that move.
//!
//! Votes spread along surfaces and stop at depth discontinuities (the recursive filter of Gastal and
//! Oliveira, "Domain transform for edge-aware image and video processing", 2011). A cell moves if most
//! of the votes that reach it are for movement. It reads votes and depth, no image.

use super::history::Votes;
use crate::image::Image;
use crate::simd::{self, Kernel};

/// Votes and depth of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellEvidence {
    /// The votes of frames and models.
    pub votes: Votes,
    /// Depth, meters; 0 where none was measured.
    pub depth_m: f32,
}

/// Votes of the Gaussian model of a cell with depth.
pub(super) const GRAY_VOTES: Votes = Votes { moves: 0.5, stands: 0.5 };
/// Votes of the Gaussian model of a cell without depth.
pub(super) const BLIND_VOTES: Votes = Votes { moves: 0.3, stands: 1.0 };
/// How far votes reach, cells.
const REACH: f32 = 4.0;
/// Largest step of depth from one cell of a surface to the next, relative.
const DEPTH_STEP: f32 = 0.02;
/// How much of a vote passes between a cell with depth and one without.
const PASSES_UNKNOWN: f32 = 0.1;
/// Share of the votes above which a cell moves.
const MOVES_SHARE: f32 = 0.6;
/// Share above which a cell connected to a moving one moves too.
const GROWS_SHARE: f32 = 0.45;
/// Least votes that must reach a moving cell.
const LEAST_VOTES: f32 = 0.2;
/// Least number of cells above [`MOVES_SHARE`] in a moving object.
const LEAST_CELLS: usize = 20;

/// The cells that move.
#[must_use]
pub fn moving_cells(evidence: &Image<CellEvidence>) -> Image<bool> {
    let shares = spread(evidence).map(|Votes { moves, stands }| {
        let votes = moves + stands;
        if votes < LEAST_VOTES { 0.0 } else { moves / votes }
    });
    let (columns, rows) = shares.size();
    let mut moving = shares.map(|_| false);
    let mut is_left = shares.map(|share| share >= GROWS_SHARE);
    let mut thing = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            take_thing(&mut is_left, (column, row), &mut thing);
            let is_sure = |&&(c, r): &&(usize, usize)| shares.at(c, r) >= MOVES_SHARE;
            if thing.iter().filter(is_sure).count() >= LEAST_CELLS {
                thing.iter().for_each(|&(c, r)| moving.set(c, r, true));
            }
        }
    }
    moving
}

/// Moves the connected cells around `start` that are left into `thing`.
fn take_thing(is_left: &mut Image<bool>, start: (usize, usize), thing: &mut Vec<(usize, usize)>) {
    let (columns, rows) = is_left.size();
    thing.clear();
    if is_left.at(start.0, start.1) {
        is_left.set(start.0, start.1, false);
        thing.push(start);
    }
    let mut next = 0;
    while let Some(&(column, row)) = thing.get(next) {
        next += 1;
        let beside = [
            (column.wrapping_sub(1), row),
            (column + 1, row),
            (column, row.wrapping_sub(1)),
            (column, row + 1),
        ];
        for (c, r) in beside {
            if c < columns && r < rows && is_left.at(c, r) {
                is_left.set(c, r, false);
                thing.push((c, r));
            }
        }
    }
}

/// The votes that reach each cell along its surface.
fn spread(evidence: &Image<CellEvidence>) -> Image<Votes> {
    /// After two rounds, votes reach about as far across rows as along them.
    const ROUNDS: usize = 2;
    let depths = evidence.map(|cell| cell.depth_m);
    let across = transposed(&depths);
    let (passes_across, passes_down) = (passes(&across), passes(&depths));
    let spread = |votes: Image<f32>| {
        (0..ROUNDS).fold(votes, |votes, _| {
            let mut votes = transposed(&votes);
            simd::run(Columns { values: &mut votes, passes: &passes_across });
            let mut votes = transposed(&votes);
            simd::run(Columns { values: &mut votes, passes: &passes_down });
            votes
        })
    };
    let moves = spread(evidence.map(|cell| cell.votes.moves));
    let stands = spread(evidence.map(|cell| cell.votes.stands));
    let mut votes = evidence.map(|cell| cell.votes);
    let spread = moves.pixels().iter().zip(stands.pixels());
    for (votes, (&moves, &stands)) in votes.pixels_mut().iter_mut().zip(spread) {
        *votes = Votes { moves, stands };
    }
    votes
}

/// Swaps columns and rows: a pass along rows becomes one along columns, many columns at a time.
fn transposed(image: &Image<f32>) -> Image<f32> {
    let (columns, rows) = image.size();
    let mut out = Image::filled(rows, columns, 0.0);
    for column in 0..columns {
        let pixels = image.pixels()[column..].iter().step_by(columns);
        out.row_mut(column).iter_mut().zip(pixels).for_each(|(out, &pixel)| *out = pixel);
    }
    out
}

/// The share of a vote that passes between each cell and the one above it.
fn passes(depths: &Image<f32>) -> Image<f32> {
    let (columns, rows) = depths.size();
    let fade = (-1.0 / REACH).exp();
    let mut passes = Image::filled(columns, rows, 0.0);
    for row in 1..rows {
        let pairs = depths.row(row - 1).iter().zip(depths.row(row));
        for (share, (&a, &b)) in passes.row_mut(row).iter_mut().zip(pairs) {
            *share = match (a > 0.0, b > 0.0) {
                (true, true) if (a - b).abs() < DEPTH_STEP * a.min(b) => fade,
                (true, true) => 0.0,
                (false, false) => fade,
                _ => PASSES_UNKNOWN * fade,
            };
        }
    }
    passes
}

/// Passes values down all columns and up again.
struct Columns<'a> {
    values: &'a mut Image<f32>,
    passes: &'a Image<f32>,
}

impl Kernel for Columns<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (columns, rows) = self.values.size();
        let between = |from: &[f32], to: &mut [f32], shares: &[f32]| {
            for ((to, &from), &share) in to.iter_mut().zip(from).zip(shares) {
                *to += share * (from - *to);
            }
        };
        for row in 1..rows {
            let (above, here) = self.values.pixels_mut().split_at_mut(row * columns);
            let above = &above[(row - 1) * columns..];
            between(above, &mut here[..columns], self.passes.row(row));
        }
        for row in (1..rows).rev() {
            let (above, here) = self.values.pixels_mut().split_at_mut(row * columns);
            let above = &mut above[(row - 1) * columns..];
            between(&here[..columns], above, self.passes.row(row));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STANDS: Votes = Votes { moves: 0.0, stands: 4.0 };
    const MOVES: Votes = Votes { moves: 4.0, stands: 1.0 };

    /// A static wall at 2 m.
    fn wall() -> Image<CellEvidence> {
        Image::filled(100, 80, CellEvidence { votes: STANDS, depth_m: 2.0 })
    }

    fn is_box(column: usize, row: usize) -> bool {
        (30..70).contains(&column) && (20..60).contains(&row)
    }

    fn with_box(cell: impl Fn(usize, usize) -> CellEvidence) -> Image<CellEvidence> {
        let mut evidence = wall();
        for row in 20..60 {
            (30..70).for_each(|column| evidence.set(column, row, cell(column, row)));
        }
        evidence
    }

    #[test]
    fn a_thing_moves_as_a_whole_where_part_of_it_is_known_to_and_the_wall_behind_does_not() {
        let evidence = with_box(|column, _| {
            let votes = if column < 60 { MOVES } else { Votes::default() };
            CellEvidence { votes, depth_m: 1.2 }
        });
        let moving = moving_cells(&evidence);
        for row in 0..80 {
            for column in 0..100 {
                assert_eq!(moving.at(column, row), is_box(column, row), "{column} {row}");
            }
        }
    }

    #[test]
    fn a_thing_that_touches_a_still_wall_ends_near_there() {
        let evidence = with_box(|_, _| CellEvidence { votes: MOVES, depth_m: 1.99 });
        let moving = moving_cells(&evidence);
        for row in 0..80 {
            for column in 0..100 {
                let is_deep = (40..60).contains(&column) && (30..50).contains(&row);
                let is_beyond = !(28..72).contains(&column) || !(18..62).contains(&row);
                if is_deep || is_beyond {
                    assert_eq!(moving.at(column, row), is_deep, "{column} {row}");
                }
            }
        }
    }

    #[test]
    fn single_cells_and_cells_of_which_nothing_is_known_do_not_move() {
        let mut evidence = wall();
        evidence.set(5, 5, CellEvidence { votes: MOVES, depth_m: 1.2 });
        evidence.set(20, 20, CellEvidence { votes: MOVES, depth_m: 2.0 });
        assert!(!moving_cells(&evidence).pixels().contains(&true));
        let unknown = evidence.map(|_| CellEvidence { depth_m: 1.0, ..CellEvidence::default() });
        assert!(!moving_cells(&unknown).pixels().contains(&true));
    }

    #[test]
    fn without_depth_the_votes_of_gray_levels_decide() {
        let foreground = Votes { stands: 0.0, ..BLIND_VOTES };
        let moving =
            moving_cells(&with_box(|_, _| CellEvidence { votes: foreground, depth_m: 0.0 }));
        assert!(moving.at(50, 40) && !moving.at(5, 40), "a patch without depth");
        let background = Votes { moves: 0.0, ..BLIND_VOTES };
        let still = with_box(|_, _| CellEvidence { votes: background, depth_m: 0.0 });
        assert!(!moving_cells(&still).pixels().contains(&true));
    }
}
