//! Dilates masks: a moving object has soft edges and depth shadows around it.

use crate::image::Image;

/// 255 within `by` pixels of what is not 0, along rows and columns.
pub(super) fn dilated(mask: &Image<u8>, by: usize) -> Image<u8> {
    let (width, height) = mask.size();
    let mut wide = Image::filled(width, height, 0);
    for v in 0..height {
        let (row, out) = (mask.row(v), wide.row_mut(v));
        // Counts down the columns that are still within reach of the mask.
        let mut spread = |columns: &mut dyn Iterator<Item = usize>| {
            let mut left = 0;
            for u in columns {
                left = if row[u] > 0 { by + 1 } else { left };
                if left > 0 {
                    out[u] = 255;
                    left -= 1;
                }
            }
        };
        spread(&mut (0..width));
        spread(&mut (0..width).rev());
    }
    let mut tall = Image::filled(width, height, 0);
    for v in 0..height {
        let out = tall.row_mut(v);
        for row in v.saturating_sub(by)..(v + by + 1).min(height) {
            for (out, &value) in out.iter_mut().zip(wide.row(row)) {
                *out |= value;
            }
        }
    }
    tall
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_becomes_a_square() {
        let mut mask = Image::filled(12, 9, 0);
        mask.set(1, 1, 1);
        mask.set(9, 5, 255);
        let wide = dilated(&mask, 2);
        for v in 0..9_usize {
            for u in 0..12_usize {
                let near = |x: usize, y: usize| u.abs_diff(x) <= 2 && v.abs_diff(y) <= 2;
                let expected = if near(1, 1) || near(9, 5) { 255 } else { 0 };
                assert_eq!(wide.at(u, v), expected, "{u} {v}");
            }
        }
        let same = dilated(&mask, 0);
        assert!(same.pixels().iter().zip(mask.pixels()).all(|(a, b)| (*a > 0) == (*b > 0)));
    }
}
