//! Nearest and farthest depth of each part of an image: tiles of 8 × 8 pixels, of 16 × 16, and so on.
//!
//! Pixels without depth are ignored. Knows neither poses nor blocks.

use crate::image::Image;

/// Edge of the smallest tiles, pixels.
pub(super) const TILE: usize = 8;
/// A query reads at most this many tiles along each axis, and one more where it crosses a border.
const ACROSS: usize = 4;

/// Nearest and farthest, meters; infinity and 0 where nothing was measured.
pub(super) type Range = [f32; 2];

/// The range without any depth.
pub(super) const NOTHING: Range = [f32::INFINITY, 0.0];

/// Ranges of tiles, each level half as wide and high as the one before.
#[derive(Clone, Debug)]
pub(super) struct Tiles {
    levels: Vec<Image<Range>>,
}

impl Tiles {
    /// Tiles for images of this size.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let (mut width, mut height) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut levels = vec![Image::filled(width, height, NOTHING)];
        while width * height > 1 {
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
            levels.push(Image::filled(width, height, NOTHING));
        }
        Self { levels }
    }

    /// Tiles along a row.
    pub(super) fn width(&self) -> usize {
        self.levels[0].width()
    }

    /// The smallest tiles, row by row.
    pub(super) fn smallest_mut(&mut self) -> &mut [Range] {
        self.levels[0].pixels_mut()
    }

    /// Makes the coarser levels from the smallest tiles.
    pub(super) fn build(&mut self) {
        for i in 1..self.levels.len() {
            let (finer, coarser) = self.levels.split_at_mut(i);
            let (finer, coarser) = (&finer[i - 1], &mut coarser[0]);
            for y in 0..coarser.height() {
                for x in 0..coarser.width() {
                    let mut range = NOTHING;
                    for row in 2 * y..(2 * y + 2).min(finer.height()) {
                        for column in 2 * x..(2 * x + 2).min(finer.width()) {
                            range = join(range, finer.at(column, row));
                        }
                    }
                    coarser.set(x, y, range);
                }
            }
        }
    }

    /// The range of all pixels from `(left, top)` to `(right, bottom)`, both included and inside the
    /// image, and of some around them.
    #[inline(always)]
    pub(super) fn range(&self, left: usize, top: usize, right: usize, bottom: usize) -> Range {
        let (mut level, mut edge) = (0, TILE);
        while (right - left).max(bottom - top) > ACROSS * edge && level + 1 < self.levels.len() {
            (level, edge) = (level + 1, 2 * edge);
        }
        let level = &self.levels[level];
        let (right, bottom) = (right / edge, bottom / edge);
        let mut out = NOTHING;
        for row in top / edge..=bottom.min(level.height() - 1) {
            for range in &level.row(row)[left / edge..=right.min(level.width() - 1)] {
                out = join(out, *range);
            }
        }
        out
    }
}

/// The range of both.
#[inline]
pub(super) fn join(a: Range, b: Range) -> Range {
    [if b[0] < a[0] { b[0] } else { a[0] }, if b[1] > a[1] { b[1] } else { a[1] }]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_all_that_was_measured() {
        let (width, height) = (100, 60);
        let mut tiles = Tiles::new(width, height);
        let depth =
            |u: usize, v: usize| if (u + v).is_multiple_of(7) { 0.0 } else { (u * v) as f32 };
        let columns = tiles.width();
        for (i, tile) in tiles.smallest_mut().iter_mut().enumerate() {
            for v in (i / columns * TILE..).take(TILE).take_while(|&v| v < height) {
                for u in (i % columns * TILE..).take(TILE).take_while(|&u| u < width) {
                    let z = depth(u, v);
                    *tile = if z > 0.0 { join(*tile, [z, z]) } else { *tile };
                }
            }
        }
        tiles.build();
        for (left, top, right, bottom) in
            [(0, 0, 99, 59), (3, 4, 5, 6), (50, 2, 99, 9), (8, 8, 40, 59)]
        {
            let mut exact = NOTHING;
            for v in top..=bottom {
                for u in left..=right {
                    let z = depth(u, v);
                    exact = if z > 0.0 { join(exact, [z, z]) } else { exact };
                }
            }
            let range = tiles.range(left, top, right, bottom);
            assert!(range[0] <= exact[0] && range[1] >= exact[1], "{range:?} {exact:?}");
        }
        assert_eq!(tiles.range(0, 0, 99, 59)[1], depth(99, 59).max(depth(98, 59)));
        assert_eq!(tiles.range(0, 0, 0, 0)[1], depth(7, 6).max(depth(6, 7)).max(depth(6, 6)));
    }
}
