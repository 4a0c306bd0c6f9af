//! The triangles of a cell: the 256 cases of marching cubes, derived from one rule per face.
//!
//! Corner i of a cell lies at (i & 1, i >> 1 & 1, i >> 2). Edge 4 axis + k runs along an axis; k counts
//! its place on the other two, the lower axis first. Around a face, one segment cuts off each run of
//! corners inside. The segments depend on the face's four corners alone, so that both cells of a face
//! have the same segments and the surface is closed for all signs, ambiguous faces included (Dürst 1988
//! on the holes in the table of Lorensen and Cline 1987). The segments of a cell's six faces form
//! loops. Each loop becomes a fan of triangles with no inner edge on a face. Independent of voxels.

use std::sync::LazyLock;

/// Edges of a cell.
const EDGES: usize = 12;
/// Most triangles of a cell.
pub(super) const TRIANGLES: usize = 5;

/// The triangles of one case, as edges on which the corners lie; seen from outside, they turn
/// counterclockwise.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Case {
    triangles: [[u8; 3]; TRIANGLES],
    count: u8,
}

impl Case {
    /// Its triangles.
    pub(super) fn triangles(&self) -> &[[u8; 3]] {
        &self.triangles[..usize::from(self.count)]
    }
}

/// Every case; bit i of the index tells whether corner i lies inside, behind the surface.
pub(super) static CASES: LazyLock<[Case; 256]> =
    LazyLock::new(|| std::array::from_fn(|inside| case(inside as u8)));

/// The lower corner of an edge, and its axis.
pub(super) fn edge_base(edge: usize) -> (usize, usize) {
    let (axis, k) = (edge / 4, edge % 4);
    let (first, second) = OTHERS[axis];
    ((k & 1) << first | (k >> 1) << second, axis)
}

/// For each axis the two others, the lower first.
const OTHERS: [(usize, usize); 3] = [(1, 2), (0, 2), (0, 1)];

/// The edge between two neighboring corners.
fn edge_between(a: usize, b: usize) -> usize {
    let axis = (a ^ b).trailing_zeros() as usize;
    let (first, second) = OTHERS[axis];
    let base = a & b;
    4 * axis + ((base >> first & 1) | (base >> second & 1) << 1)
}

/// The corners of a face, counterclockwise as seen from outside of the cell.
fn face_corners(axis: usize, is_upper: bool) -> [usize; 4] {
    // The other two axes such that (a, b, axis) is right-handed.
    let (a, b) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    if is_upper {
        let base = 1 << axis;
        [base, base | a, base | a | b, base | b]
    } else {
        [0, b, a | b, a]
    }
}

/// The faces on which an edge lies, as bits.
fn faces_of(edge: usize) -> u8 {
    let (base, axis) = edge_base(edge);
    (0..3).filter(|&other| other != axis).map(|other| 1 << (2 * other + (base >> other & 1))).sum()
}

fn case(inside: u8) -> Case {
    let is_inside = |corner: usize| inside >> corner & 1 == 1;
    // The crossing edge that follows each crossing edge on its loop.
    let mut next = [None; EDGES];
    for face in 0..6 {
        let corners = face_corners(face / 2, face % 2 == 1);
        for start in 0..4 {
            let at = |k: usize| corners[(start + k) % 4];
            if is_inside(at(0)) || !is_inside(at(1)) {
                continue;
            }
            // A run of corners inside begins at 1 and ends at `last`.
            let last = (1..4).take_while(|&k| is_inside(at(k))).last().unwrap_or(1);
            let (enter, exit) = (edge_between(at(0), at(1)), edge_between(at(last), at(last + 1)));
            next[enter] = Some(exit);
        }
    }
    let mut case = Case::default();
    for first in 0..EDGES {
        let mut polygon = Vec::new();
        let mut edge = first;
        while let Some(following) = next[edge].take() {
            polygon.push(edge);
            edge = following;
        }
        if !polygon.is_empty() {
            push_fan(&mut case, &polygon);
        }
    }
    case
}

/// Cuts a loop into triangles from the corner whose fan has the fewest inner edges on a face of the
/// cell, where the neighbor could have the same one.
fn push_fan(case: &mut Case, polygon: &[usize]) {
    let n = polygon.len();
    let on_faces = |&apex: &usize| {
        let inner = (2..n - 1).map(|k| polygon[(apex + k) % n]);
        inner.filter(|&edge| faces_of(edge) & faces_of(polygon[apex]) != 0).count()
    };
    let apex = (0..n).min_by_key(on_faces).unwrap_or(0);
    for k in 1..n - 1 {
        let corner = |k: usize| polygon[(apex + k) % n] as u8;
        case.triangles[usize::from(case.count)] = [corner(0), corner(k), corner(k + 1)];
        case.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Edges without a reverse edge in another triangle of the case.
    fn boundary(case: &Case) -> Vec<(u8, u8)> {
        let turns = |t: &[u8; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
        let mut all: Vec<_> = case.triangles().iter().flat_map(turns).collect();
        while let Some((i, j)) = (0..all.len()).find_map(|i| {
            all.iter().position(|&(a, b)| (b, a) == all[i]).map(|j| (i.min(j), i.max(j)))
        }) {
            all.remove(j);
            all.remove(i);
        }
        all
    }

    fn faces_of_segment((a, b): (u8, u8)) -> u8 {
        faces_of(a.into()) & faces_of(b.into())
    }

    #[test]
    fn every_crossing_edge_has_its_corner_and_no_other_has() {
        for inside in 0..256 {
            let mut used = [false; EDGES];
            for &edge in CASES[inside].triangles().iter().flatten() {
                used[usize::from(edge)] = true;
            }
            for edge in 0..EDGES {
                let (base, axis) = edge_base(edge);
                let crosses = (inside >> base ^ inside >> (base | 1 << axis)) & 1 == 1;
                assert_eq!(used[edge], crosses, "case {inside:08b}, edge {edge}");
            }
        }
    }

    #[test]
    fn the_boundary_of_a_cell_lies_on_its_faces_and_inner_edges_do_not() {
        for inside in 0..256 {
            let case = &CASES[inside];
            let boundary = boundary(case);
            for &segment in &boundary {
                assert_eq!(faces_of_segment(segment).count_ones(), 1, "case {inside:08b}");
            }
            for t in case.triangles() {
                for segment in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                    let is_on_face = faces_of_segment(segment) != 0;
                    assert_eq!(is_on_face, boundary.contains(&segment), "case {inside:08b}");
                }
            }
        }
    }

    #[test]
    fn neighboring_cells_close_each_other_whatever_their_signs() {
        for axis in 0..3 {
            let mirrored = |edge: u8| {
                let (base, along) = edge_base(edge.into());
                edge_between(base ^ 1 << axis, (base | 1 << along) ^ 1 << axis) as u8
            };
            let on = |case: usize, face: u8| {
                let mut segments = boundary(&CASES[case]);
                segments.retain(|&segment| faces_of_segment(segment) == 1 << face);
                segments
            };
            let upper = |case: usize| {
                (0..8).filter(|i| i >> axis & 1 == 1).fold(0, |m, i| m | (case >> i & 1) << i)
            };
            for (a, b) in (0..256).flat_map(|a| (0..256).map(move |b| (a, b))) {
                let shared = (0..8).fold(0, |m, i| m | (b >> i & 1) << (i ^ 1 << axis));
                if upper(a) != upper(shared) {
                    continue;
                }
                let mut mine = on(a, 2 * axis as u8 + 1);
                let mut theirs: Vec<_> = on(b, 2 * axis as u8)
                    .into_iter()
                    .map(|(from, to)| (mirrored(to), mirrored(from)))
                    .collect();
                mine.sort_unstable();
                theirs.sort_unstable();
                assert_eq!(mine, theirs, "cases {a:08b} and {b:08b} along axis {axis}");
            }
        }
    }

    #[test]
    fn triangles_face_the_outside() {
        // Corner 0 alone is inside: the triangle's normal points away from it.
        let middle =
            |edge: u8| {
                let (base, axis) = edge_base(edge.into());
                std::array::from_fn::<f64, 3, _>(|i| {
                    if i == axis { 0.5 } else { (base >> i & 1) as f64 }
                })
            };
        let [a, b, c] = CASES[1].triangles()[0].map(middle);
        let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
        let normal = [0, 1, 2]
            .map(|i: usize| u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]);
        assert!(normal.iter().all(|&n| n > 0.0), "{normal:?}");
    }
}
