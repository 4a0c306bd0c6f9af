//! The room that all scenes share: walls, desk, shelves, posters, and what lies on them.
//!
//! The world's z points up, the origin lies on the floor in the middle. Each seed moves things a
//! little and paints everything anew. Nothing here moves.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::material::{Albedo, Kind, Material};
use super::solid::{Shape, Solid, upright};

/// Half edges of the room, m.
pub(super) const HALF_ROOM_M: [f64; 3] = [2.6, 2.2, 1.35];

/// The height of the desk's top, m.
pub(super) const DESK_M: f64 = 0.74;

/// Places things and paints them.
struct Decorator {
    rng: ChaCha8Rng,
    solids: Vec<Solid>,
}

/// The solids that stand still.
pub(super) fn furnished(seed: u64) -> Vec<Solid> {
    let mut decorator = Decorator { rng: ChaCha8Rng::seed_from_u64(seed), solids: Vec::new() };
    decorator.walls();
    decorator.desk();
    decorator.shelves();
    decorator.posters();
    decorator.floor();
    decorator.solids
}

impl Decorator {
    fn walls(&mut self) {
        let material = self.material(Kind::Plaster, [0.35, 0.32, 0.28], [0.95, 0.9, 0.82]);
        let center = Vector3::new(0.0, 0.0, HALF_ROOM_M[2]);
        let world_from_solid = upright(center, 0.0);
        self.solids.push(Solid {
            shape: Shape::Room(HALF_ROOM_M.into()),
            world_from_solid,
            material,
        });
        let carpet = self.material(Kind::Carpet, [0.12, 0.1, 0.14], [0.75, 0.6, 0.5]);
        self.place([0.0, 0.0, 0.005], [5.2, 4.4, 0.01], 0.0, carpet);
    }

    /// Along the far wall.
    fn desk(&mut self) {
        let y = 1.75;
        let wood = self.material(Kind::Wood, [0.25, 0.14, 0.07], [0.85, 0.62, 0.4]);
        self.place([0.0, y, DESK_M - 0.02], [2.2, 0.8, 0.04], 0.0, wood);
        for (x, dy) in [(-1.05, -0.35), (1.05, -0.35), (-1.05, 0.35), (1.05, 0.35)] {
            self.place([x, y + dy, 0.36], [0.06, 0.06, 0.72], 0.0, wood);
        }
        let drawers = self.material(Kind::Wood, [0.2, 0.2, 0.22], [0.7, 0.7, 0.75]);
        self.place([0.75, y, 0.32], [0.45, 0.6, 0.6], 0.0, drawers);
        // Monitor, keyboard, papers.
        let turn = self.about(-0.1, 0.2);
        let x = self.about(-0.25, 0.15);
        let frame = self.material(Kind::Plain, [0.02; 3], [0.2; 3]);
        let screen = self.poster();
        self.place([x, y + 0.15, DESK_M + 0.3], [0.6, 0.04, 0.38], turn, frame);
        self.place([x, y + 0.127, DESK_M + 0.3], [0.55, 0.04, 0.33], turn, screen);
        self.place([x, y + 0.17, DESK_M + 0.06], [0.08, 0.06, 0.12], turn, frame);
        let keys = self.material(Kind::Cloth, [0.03; 3], [0.8; 3]);
        self.place([x, y - 0.2, DESK_M + 0.01], [0.42, 0.14, 0.02], turn, keys);
        for _ in 0..4 {
            let paper = self.poster();
            let (px, py) = (self.about(0.2, 0.8), self.about(y - 0.2, 0.15));
            let turn = self.about(0.0, 0.8);
            let height = self.about(0.01, 0.008);
            self.place([px, py, DESK_M + 0.5 * height], [0.21, 0.29, height], turn, paper);
        }
        // Books in a row, a globe, a mug, a lamp, boxes.
        for i in 0..5 {
            let cover = self.material(Kind::Books, [0.1, 0.05, 0.05], [0.95, 0.8, 0.6]);
            let height = self.about(0.24, 0.05);
            let x = 0.35 + 0.065 * f64::from(i);
            self.place([x, y + 0.2, DESK_M + 0.5 * height], [0.055, 0.18, height], 0.0, cover);
        }
        let globe = self.material(Kind::Poster, [0.05, 0.15, 0.4], [0.7, 0.9, 0.8]);
        let x = self.about(0.85, 0.08);
        self.solids.push(Solid::ball([x, y + 0.05, DESK_M + 0.15], 0.15, globe));
        let glaze = self.material(Kind::Cloth, [0.5, 0.1, 0.1], [0.95, 0.9, 0.9]);
        let (x, low) = (self.about(-0.7, 0.1), DESK_M + 0.04);
        self.pillar([x, y - 0.15, low], 0.04, 0.04, glaze);
        let metal = self.material(Kind::Plain, [0.2, 0.15, 0.02], [0.9, 0.75, 0.2]);
        self.pillar([-0.95, y + 0.2, DESK_M + 0.02], 0.5, 0.015, metal);
        self.solids.push(Solid::ball([-0.92, y + 0.15, DESK_M + 0.52], 0.09, metal));
        let turn = self.about(0.5, 0.4);
        let carton = self.poster();
        self.place([-0.7, y + 0.1, DESK_M + 0.1], [0.22, 0.16, 0.2], turn, carton);
    }

    /// Left and right, and one behind, so that every view has depth.
    fn shelves(&mut self) {
        for (x, y, turned) in [(-2.4, 0.4, true), (2.4, -0.3, true), (-0.9, -2.02, false)] {
            let edges = |a: f64, b: f64, c: f64| if turned { [b, a, c] } else { [a, b, c] };
            let wood = self.material(Kind::Wood, [0.18, 0.12, 0.08], [0.7, 0.55, 0.4]);
            for board in 0..5 {
                let z = 0.08 + 0.4 * f64::from(board);
                self.place([x, y, z], edges(1.3, 0.32, 0.03), 0.0, wood);
                if board == 4 {
                    break;
                }
                let along = self.about(0.0, 0.15);
                let books = self.material(Kind::Books, [0.05, 0.06, 0.1], [0.95, 0.85, 0.7]);
                let height = self.about(0.27, 0.05);
                let (bx, by) = if turned { (x, y + along) } else { (x + along, y) };
                let row = edges(self.about(0.7, 0.2), 0.22, height);
                self.place([bx, by, z + 0.015 + 0.5 * height], row, 0.0, books);
            }
            for side in [-0.64, 0.64] {
                let (sx, sy) = if turned { (x, y + side) } else { (x + side, y) };
                self.place([sx, sy, 0.9], edges(0.03, 0.34, 1.8), 0.0, wood);
            }
        }
    }

    fn posters(&mut self) {
        let [hx, hy, _] = HALF_ROOM_M;
        let far = [(-1.5, 1.65), (-0.45, 1.75), (0.6, 1.6), (1.6, 1.7), (-1.9, 0.8), (1.9, 0.75)];
        for (x, z) in far {
            let (x, z) = (self.about(x, 0.1), self.about(z, 0.1));
            let (width, height) = (self.about(0.6, 0.15), self.about(0.7, 0.15));
            let poster = self.poster();
            self.place([x, hy - 0.01, z], [width, 0.02, height], 0.0, poster);
            let poster = self.poster();
            self.place([-x, -hy + 0.01, z], [height, 0.02, width], 0.0, poster);
        }
        for y in [-1.4, 1.5] {
            for (x, sign) in [(hx - 0.01, -1.0), (0.01 - hx, 1.0)] {
                let poster = self.poster();
                let (y, z) = (self.about(sign * y, 0.1), self.about(1.5, 0.2));
                self.place([x, y, z], [0.02, 0.6, 0.8], 0.0, poster);
            }
        }
    }

    /// A carton, a ball, a bin and a pillar.
    fn floor(&mut self) {
        let turn = self.about(0.4, 0.4);
        let carton = self.poster();
        self.place([-1.75, 1.5, 0.2], [0.5, 0.45, 0.4], turn, carton);
        let rubber = self.material(Kind::Poster, [0.4, 0.05, 0.05], [0.95, 0.9, 0.5]);
        self.solids.push(Solid::ball([1.6, 1.4, 0.23], 0.22, rubber));
        let bin = self.material(Kind::Cloth, [0.1, 0.2, 0.15], [0.5, 0.8, 0.6]);
        self.pillar([1.4, -1.6, 0.15], 0.3, 0.16, bin);
    }

    /// An upright capsule from `from` up.
    fn pillar(&mut self, from: [f64; 3], length: f64, radius: f64, material: Material) {
        let from = Vector3::from(from);
        let to = from + Vector3::new(0.0, 0.0, length);
        self.solids.push(Solid::capsule(from, to, radius, Vector3::y(), material));
    }

    fn place(&mut self, center: [f64; 3], edges: [f64; 3], turn_rad: f64, material: Material) {
        self.solids.push(Solid::upright_box(center, edges, turn_rad, material));
    }

    fn poster(&mut self) -> Material {
        let dark = [0.03; 3].map(|low| low + 0.15 * self.rng.random::<f32>());
        let light = [0.75; 3].map(|low| low + 0.22 * self.rng.random::<f32>());
        self.material(Kind::Poster, dark, light)
    }

    fn material(&mut self, kind: Kind, dark: Albedo, light: Albedo) -> Material {
        Material { kind, dark, light, seed: self.rng.random() }
    }

    /// A number within `spread` of `middle`.
    fn about(&mut self, middle: f64, spread: f64) -> f64 {
        middle + spread * (2.0 * self.rng.random::<f64>() - 1.0)
    }
}
