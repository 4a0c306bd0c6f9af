//! What surfaces look like: layers of random cells, from smooth noise to mosaics with hard corners.
//!
//! A layer is a lattice of random values, mixed near the borders of its cells. The mixing is as wide
//! as a pixel's footprint at least, and a layer whose cells are smaller than that fades away: textures
//! do not alias, and no ray is shot twice for them. Layers are turned against each other and hashed by
//! position, so that nothing repeats. Textures stand in a solid's own axes and move with it. Knows no
//! light and no camera.

use nalgebra::Vector3;

use super::random;

/// Red, green, blue: reflected share of the light.
pub(super) type Albedo = [f32; 3];

/// A lattice of random values.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Layer {
    /// Cells a meter, along both axes.
    rate: [f32; 2],
    /// How much of a cell its border takes: 0 is a mosaic, 1 smooth noise.
    border: f32,
    /// Share of the whole.
    weight: f32,
    /// How far the three colors vary apart, 0 (gray) to 1.
    hue: f32,
    /// Cosine and sine of the lattice's turn.
    turn: [f32; 2],
}

/// `cell`: edges of a cell, m.
const fn layer(cell: [f32; 2], border: f32, weight: f32, hue: f32, turn: [f32; 2]) -> Layer {
    let rate = [1.0 / cell[0], 1.0 / cell[1]];
    Layer { rate, border, weight, hue, turn }
}

const STRAIGHT: [f32; 2] = [1.0, 0.0];
const OBLIQUE: [f32; 2] = [0.8, 0.6];
const STEEP: [f32; 2] = [0.28, 0.96];

/// The kinds of surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Painted walls with stains and prints.
    Plaster,
    /// Strong shapes at several scales.
    Poster,
    /// Grain along x, planks.
    Wood,
    /// Large cells and a speckle.
    Carpet,
    /// Upright spines.
    Books,
    /// Checks and threads.
    Cloth,
    /// Nearly plain, with a speckle.
    Plain,
}

impl Kind {
    fn layers(self) -> &'static [Layer] {
        const PLASTER: [Layer; 4] = [
            layer([0.9, 0.7], 1.0, 0.35, 0.15, OBLIQUE),
            layer([0.31, 0.23], 0.1, 0.2, 0.15, STEEP),
            layer([0.06, 0.06], 1.0, 0.22, 0.0, OBLIQUE),
            layer([0.014, 0.014], 0.8, 0.18, 0.0, STRAIGHT),
        ];
        const POSTER: [Layer; 3] = [
            layer([0.16, 0.11], 0.0, 0.45, 0.7, STRAIGHT),
            layer([0.045, 0.06], 0.0, 0.33, 0.7, OBLIQUE),
            layer([0.013, 0.017], 0.1, 0.22, 0.0, STEEP),
        ];
        const WOOD: [Layer; 4] = [
            layer([1.3, 0.11], 0.02, 0.35, 0.0, STRAIGHT),
            layer([0.25, 0.012], 0.9, 0.35, 0.0, STRAIGHT),
            layer([0.05, 0.05], 1.0, 0.15, 0.0, OBLIQUE),
            layer([0.02, 0.006], 0.8, 0.15, 0.0, STRAIGHT),
        ];
        const CARPET: [Layer; 3] = [
            layer([0.33, 0.33], 0.03, 0.4, 0.3, OBLIQUE),
            layer([0.08, 0.05], 0.2, 0.3, 0.3, STEEP),
            layer([0.015, 0.015], 0.8, 0.3, 0.0, STRAIGHT),
        ];
        const BOOKS: [Layer; 3] = [
            layer([0.032, 0.6], 0.0, 0.65, 0.8, STRAIGHT),
            layer([0.032, 0.05], 0.05, 0.2, 0.8, STRAIGHT),
            layer([0.008, 0.012], 0.3, 0.15, 0.0, STRAIGHT),
        ];
        const CLOTH: [Layer; 3] = [
            layer([0.09, 0.11], 0.1, 0.45, 0.3, OBLIQUE),
            layer([0.03, 0.03], 0.1, 0.35, 0.0, STEEP),
            layer([0.01, 0.01], 0.7, 0.2, 0.0, STRAIGHT),
        ];
        const PLAIN: [Layer; 2] = [
            layer([0.12, 0.12], 1.0, 0.6, 0.0, OBLIQUE),
            layer([0.02, 0.02], 0.8, 0.4, 0.0, STEEP),
        ];
        match self {
            Self::Plaster => &PLASTER,
            Self::Poster => &POSTER,
            Self::Wood => &WOOD,
            Self::Carpet => &CARPET,
            Self::Books => &BOOKS,
            Self::Cloth => &CLOTH,
            Self::Plain => &PLAIN,
        }
    }
}

/// A kind of surface between two colors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Material {
    /// Its layers.
    pub(super) kind: Kind,
    /// Where the layers are 0.
    pub(super) dark: Albedo,
    /// Where the layers are 1.
    pub(super) light: Albedo,
    /// Which of all textures of the kind.
    pub(super) seed: u32,
}

/// How much the sum of the layers is spread about its mean, since means of many are alike.
const CONTRAST: f32 = 1.7;

impl Material {
    /// A face.
    pub(super) const SKIN: Self =
        Self { kind: Kind::Plain, dark: [0.45, 0.28, 0.2], light: [0.9, 0.68, 0.55], seed: 7 };

    /// The color of a point on a flat face, (u, v) its position there, m. `footprint` is the width of a
    /// pixel there, m.
    pub(super) fn flat(&self, u: f32, v: f32, face: u8, footprint: f32) -> Albedo {
        let seed = self.seed.wrapping_add(u32::from(face) * 0x9e37);
        self.mixed(footprint, |index, layer| {
            let [c, s] = layer.turn;
            let cell = [(c * u + s * v) * layer.rate[0], (c * v - s * u) * layer.rate[1]];
            let border = layer.rate.map(|rate| layer.border.max(footprint * rate).min(1.0));
            let (i, a) = split(cell[0], border[0]);
            let (j, b) = split(cell[1], border[1]);
            let seed = seed.wrapping_add(index);
            let hash = |di, dj| random::cell(i.wrapping_add(di), j.wrapping_add(dj), 0, seed);
            if layer.hue == 0.0 {
                let [gray] = mix(a, |di| mix(b, |dj| values(hash(di, dj))));
                return [gray; 3];
            }
            mix(a, |di| mix(b, |dj| values(hash(di, dj))))
        })
    }

    /// The color of a point inside the material, m.
    pub(super) fn solid(&self, point: &Vector3<f32>, footprint: f32) -> Albedo {
        self.mixed(footprint, |index, layer| {
            let [c, s] = layer.turn;
            let (x, y) = (c * point.x + s * point.y, c * point.y - s * point.x);
            let [p, q] = layer.rate;
            let border = layer.border.max(footprint * p.max(q)).min(1.0);
            let seed = self.seed.wrapping_add(index);
            let (i, a) = split(x * p, border);
            let (j, b) = split(y * p, border);
            let (k, c) = split(point.z * q, border);
            mix(a, |di| {
                mix(b, |dj| {
                    mix(c, |dk| {
                        let cell = [i.wrapping_add(di), j.wrapping_add(dj), k.wrapping_add(dk)];
                        values(random::cell(cell[0], cell[1], cell[2], seed))
                    })
                })
            })
        })
    }

    #[inline]
    fn mixed(&self, footprint: f32, cells: impl Fn(u32, &Layer) -> [f32; 3]) -> Albedo {
        let mut sum = [0.5; 3];
        for (index, layer) in (0..).zip(self.kind.layers()) {
            let fade = (2.0 - footprint * layer.rate[0].max(layer.rate[1])).clamp(0.0, 1.0);
            if fade == 0.0 {
                continue;
            }
            let values = cells(index, layer);
            let weight = CONTRAST * layer.weight * fade;
            for (channel, sum) in sum.iter_mut().enumerate() {
                let value = values[0] + layer.hue * (values[channel] - values[0]);
                *sum += weight * (value - 0.5);
            }
        }
        std::array::from_fn(|channel| {
            let share = sum[channel].clamp(0.0, 1.0);
            self.dark[channel] + share * (self.light[channel] - self.dark[channel])
        })
    }
}

/// The cell below a coordinate's border, and the weight of the one above it.
#[inline]
fn split(x: f32, border: f32) -> (i32, f32) {
    let shifted = x - 0.5;
    // Rounds down; `f32::floor` is a call on processors without SSE 4.1.
    let toward_zero = shifted as i32;
    let below = toward_zero - i32::from(shifted < toward_zero as f32);
    let past = shifted - below as f32 - 0.5;
    if past.abs() >= 0.5 * border {
        return (below, if past > 0.0 { 1.0 } else { 0.0 });
    }
    let share = past / border + 0.5;
    (below, share * share * (3.0 - 2.0 * share))
}

/// Between the cell below (0) and the one above (1); inside of a cell only that one is computed.
#[inline]
fn mix<const N: usize>(share: f32, cell: impl Fn(i32) -> [f32; N]) -> [f32; N] {
    if share <= 0.0 {
        return cell(0);
    }
    if share >= 1.0 {
        return cell(1);
    }
    let (below, above) = (cell(0), cell(1));
    std::array::from_fn(|channel| below[channel] + share * (above[channel] - below[channel]))
}

/// Up to three random numbers of a hash, 0 to 1.
#[inline]
fn values<const N: usize>(hash: u32) -> [f32; N] {
    std::array::from_fn(|channel| ((hash >> (8 * channel)) & 0xff) as f32 * (1.0 / 255.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSTER: Material =
        Material { kind: Kind::Poster, dark: [0.0; 3], light: [1.0; 3], seed: 3 };

    /// Mean squared difference of the green of neighbors that are `step` apart.
    fn roughness(step: f32, footprint: f32) -> f32 {
        let green = |i: u16| POSTER.flat(f32::from(i) * step, 0.123, 0, footprint)[1];
        (0..2000).map(|i| (green(i) - green(i + 1)).powi(2)).sum::<f32>() / 2000.0
    }

    #[test]
    fn textures_have_contrast_and_fade_where_pixels_are_large() {
        let (near, far) = (roughness(0.05, 0.002), roughness(0.05, 0.5));
        assert!(near > 0.02, "{near}");
        assert_eq!(far, 0.0);
    }

    #[test]
    fn textures_are_continuous_within_a_footprint() {
        // A hundredth of a pixel changes the color by some hundredths at most.
        let step = |i: u16| {
            let u = f32::from(i) * 0.0013;
            let (a, b) = (POSTER.flat(u, 0.2, 0, 0.004), POSTER.flat(u + 4e-5, 0.2, 0, 0.004));
            (a[0] - b[0]).abs()
        };
        let largest = (0..3000).map(step).fold(0.0, f32::max);
        assert!(largest < 0.05, "{largest}");
    }

    #[test]
    fn nothing_repeats() {
        let row = |from: f32| -> Vec<u32> {
            (0..64)
                .map(|i| POSTER.flat(from + 0.02 * i as f32, 0.3, 0, 0.001)[0].to_bits())
                .collect()
        };
        let first = row(0.0);
        assert!((1..200).all(|i| row(0.16 * i as f32) != first));
    }
}
