//! Brings color and depth to one size and one lens.
//!
//! A phone's depth is smaller than its image, its lens moves from frame to frame (focus, stabilizer),
//! and its image has more pixels than tracking uses: patches, cells and corners are meant for images of
//! about 640 columns. So color is averaged over the area of each target pixel, and depth is that of
//! the nearest pixel: the mean of a depth in front of an edge and one behind it would be a point in
//! the air. Lenses may differ in focal lengths and principal point; distortion stays as it is.

use covis_solvers::geometry::PinholeRadialTangential;

use crate::image::Image;

/// The longer side that tracking is meant for, px.
const USUAL_SIDE: f64 = 640.0;

/// The size of the target for images of this size: a whole fraction of it whose longer side is nearest
/// to [`USUAL_SIDE`]. Columns and rows, px.
pub(super) fn target_size((width, height): (usize, usize)) -> (usize, usize) {
    let factor = (width.max(height) as f64 / USUAL_SIDE).round().max(1.0) as usize;
    ((width / factor).max(1), (height / factor).max(1))
}

/// The lens of an image, as that of the same image at another size.
pub(super) fn scaled(
    lens: &PinholeRadialTangential,
    from: (usize, usize),
    to: (usize, usize),
) -> PinholeRadialTangential {
    // Whole fractions cut at most the last pixels off, and leave the scale as it is.
    let factor = (from.0.max(from.1) / to.0.max(to.1)) as f64;
    let center = |c: f64| (c + 0.5) / factor - 0.5;
    PinholeRadialTangential {
        fx: lens.fx / factor,
        fy: lens.fy / factor,
        cx: center(lens.cx),
        cy: center(lens.cy),
        ..*lens
    }
}

/// Where the pixels of a row or a column come from.
#[derive(Clone, Copy, Debug)]
struct Axis {
    /// Pixels of the source a pixel of the target.
    step: f64,
    /// The left (upper) edge of the first pixel, from that of the source.
    begin: f64,
    /// Pixels of the source and of the target.
    source: usize,
    target: usize,
}

impl Axis {
    fn new([f_source, c_source]: [f64; 2], [f, c]: [f64; 2], source: usize, target: usize) -> Self {
        let step = f_source / f;
        Self { step, begin: c_source + 0.5 - (c + 0.5) * step, source, target }
    }

    /// The middle of a pixel, from 0 to 1 over the source.
    fn middle(&self, pixel: usize) -> f64 {
        (self.begin + (pixel as f64 + 0.5) * self.step) / self.source as f64
    }

    /// For each pixel of the target the first of the source, and the share that each of those from there on
    /// has. Outside of the source its outermost pixel is repeated.
    fn shares(&self) -> Vec<(usize, Vec<f32>)> {
        let last = self.source as f64;
        let share = |pixel: usize| {
            let left = (self.begin + pixel as f64 * self.step).clamp(0.0, last - 1e-6);
            let right = (self.begin + (pixel + 1) as f64 * self.step).clamp(left + 1e-6, last);
            let first = left as usize;
            let end = (right.ceil() as usize).min(self.source);
            let part = |k: usize| right.min((k + 1) as f64) - left.max(k as f64);
            let parts = (first..end).map(|k| (part(k) / (right - left)) as f32);
            (first, parts.collect())
        };
        (0..self.target).map(share).collect()
    }
}

/// Takes images of one lens and size to another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Resampler {
    columns: Axis,
    rows: Axis,
}

impl Resampler {
    /// From images of `source` size and lens to those of `target`. Focal lengths are positive.
    pub(super) fn new(
        (source, source_size): (&PinholeRadialTangential, (usize, usize)),
        (target, target_size): (&PinholeRadialTangential, (usize, usize)),
    ) -> Self {
        let columns = [[source.fx, source.cx], [target.fx, target.cx]];
        let rows = [[source.fy, source.cy], [target.fy, target.cy]];
        Self {
            columns: Axis::new(columns[0], columns[1], source_size.0, target_size.0),
            rows: Axis::new(rows[0], rows[1], source_size.1, target_size.1),
        }
    }

    /// Color: the mean over each target pixel's area.
    pub(super) fn color(&self, image: &Image<[u8; 3]>) -> Image<[u8; 3]> {
        let (columns, rows) = (self.columns.shares(), self.rows.shares());
        let width = self.columns.target;
        let mut color = Image::filled(width, self.rows.target, [0; 3]);
        let mut narrow = vec![[0.0f32; 3]; width];
        for (v, (top, shares)) in rows.iter().enumerate() {
            let mut sums = vec![[0.5f32; 3]; width];
            for (row, &weight) in (*top..).zip(shares) {
                let row = image.row(row);
                for ((first, shares), sum) in columns.iter().zip(&mut narrow) {
                    *sum = [0.0; 3];
                    for (pixel, share) in row[*first..].iter().zip(shares) {
                        for (sum, &value) in sum.iter_mut().zip(pixel) {
                            *sum += share * f32::from(value);
                        }
                    }
                }
                for (sum, pixel) in sums.as_flattened_mut().iter_mut().zip(narrow.as_flattened()) {
                    *sum += weight * pixel;
                }
            }
            for (pixel, sum) in color.row_mut(v).iter_mut().zip(&sums) {
                *pixel = sum.map(|sum| sum as u8);
            }
        }
        color
    }

    /// Depth of any resolution that shows the same as the source's color: the nearest pixel, and `none`
    /// outside of it.
    pub(super) fn depth<T: Copy>(&self, image: &Image<T>, none: T) -> Image<T> {
        let nearest = |axis: &Axis, count: usize| -> Vec<Option<usize>> {
            let of = |pixel| {
                let at = axis.middle(pixel) * count as f64;
                (at >= 0.0 && at < count as f64).then_some(at as usize)
            };
            (0..axis.target).map(of).collect()
        };
        let columns = nearest(&self.columns, image.width());
        let rows = nearest(&self.rows, image.height());
        let mut depth = Image::filled(columns.len(), rows.len(), none);
        for (v, row) in rows.into_iter().enumerate() {
            let Some(row) = row else { continue };
            for (pixel, column) in depth.row_mut(v).iter_mut().zip(&columns) {
                *pixel = column.map_or(none, |column| image.at(column, row));
            }
        }
        depth
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(fx: f64, cx: f64) -> PinholeRadialTangential {
        PinholeRadialTangential::undistorted(fx, fx, cx, cx)
    }

    #[test]
    fn sizes_are_whole_fractions_near_the_usual_one() {
        assert_eq!(target_size((640, 480)), (640, 480));
        assert_eq!(target_size((1920, 1440)), (640, 480));
        assert_eq!(target_size((720, 960)), (360, 480));
        assert_eq!(target_size((1024, 768)), (512, 384));
        assert_eq!(target_size((4032, 3024)), (672, 504));
        assert_eq!(target_size((256, 192)), (256, 192));
        assert_eq!(target_size((1, 8192)), (1, 630));
    }

    #[test]
    fn a_smaller_image_has_its_rays_at_the_same_places() {
        let large = lens(1500.0, 959.5);
        let small = scaled(&large, (1920, 1440), (640, 480));
        assert_eq!((small.fx, small.cx), (500.0, 319.5));
        // The middle of pixel 0 is the middle of pixels 0 to 2.
        assert_eq!((0.0 - small.cx) / small.fx, (1.0 - large.cx) / large.fx);
    }

    #[test]
    fn the_same_lens_and_size_leave_images_as_they_are() {
        let pixels = (0..48).map(|k| [k as u8, (5 * k) as u8, 255 - k as u8]).collect();
        let image = Image::from_pixels(8, 6, pixels).unwrap();
        let camera = lens(7.3, 3.1);
        let same = Resampler::new((&camera, (8, 6)), (&camera, (8, 6)));
        assert_eq!(same.color(&image), image);
        let depth = Image::from_pixels(8, 6, (0..48).collect()).unwrap();
        assert_eq!(same.depth(&depth, 99), depth);
    }

    #[test]
    fn color_is_the_mean_of_the_area_and_depth_is_never_a_mean() {
        let image = Image::from_pixels(6, 3, (0..18).map(|k| [10 * k as u8; 3]).collect()).unwrap();
        let large = lens(6.0, 2.5);
        let third = Resampler::new((&large, (6, 3)), (&scaled(&large, (6, 3), (2, 1)), (2, 1)));
        // The middle of 3 x 3 pixels is their mean where values rise evenly.
        assert_eq!(third.color(&image).pixels(), [[70; 3], [100; 3]]);

        // An edge of depth of 4 columns for 12 of color: 1 m before 5 m, and nothing between.
        let depth = Image::from_pixels(4, 1, vec![1.0f32, 1.0, 5.0, 0.0]).unwrap();
        let color = lens(12.0, 5.5);
        let same = Resampler::new((&color, (12, 3)), (&color, (12, 3)));
        let found = same.depth(&depth, 0.0);
        let row = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.0, 5.0, 5.0, 0.0, 0.0, 0.0];
        assert_eq!(found.pixels(), [row, row, row].concat());
    }

    #[test]
    fn a_lens_that_moved_is_moved_back() {
        let pixels: Vec<[u8; 3]> = (0..100).map(|k| [(k % 10 * 20) as u8; 3]).collect();
        let image = Image::from_pixels(10, 10, pixels).unwrap();
        let moved = Resampler::new((&lens(8.0, 5.5), (10, 10)), (&lens(8.0, 4.5), (10, 10)));
        // What the target has at column 3 the source has at column 4.
        assert_eq!(moved.color(&image).at(3, 3), [80; 3]);
        assert_eq!(moved.color(&image).at(9, 3), [180; 3], "the rim is repeated");
        let depth = moved.depth(&image.map(|[value, ..]| value), 255);
        assert_eq!((depth.at(3, 3), depth.at(9, 3)), (80, 255), "there is no depth beyond the rim");
        // A longer lens is brought back to the shorter one around the principal point.
        let longer = Resampler::new((&lens(16.0, 4.0), (10, 10)), (&lens(8.0, 4.0), (10, 10)));
        let depth = longer.depth(&image.map(|[value, ..]| value), 255);
        assert_eq!(depth.at(4, 4), 20 * 4);
        assert_eq!(depth.at(0, 4), 255);
    }
}
