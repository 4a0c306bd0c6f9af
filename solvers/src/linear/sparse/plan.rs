//! The symbolic plan of a sparse factorization: scalar permutation, columns, scatter map, fill.
//!
//! The permuted matrix is kept as compressed scalar columns, lower triangle. All columns of one
//! block column share one list of rows with the diagonal block in full (faer skips what stands
//! above the diagonal), so a block column is a dense strip of H rows: a block lands at one start
//! with stride H, as it is or transposed, and no index per scalar is needed.
//! It holds no values.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::simplicial;
use faer::sparse::{SymbolicSparseColMat, SymbolicSparseColMatRef};

use super::super::pattern::BlockPattern;
use super::{FaerError, SymbolicSupernodalCholesky, SymbolicSupernodalParams, supernodal};

/// Where a stored block goes among the values of the permuted columns.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Placement {
    pub(super) start: usize,
    pub(super) stride: usize,
    pub(super) transposed: bool,
}

/// What a sparse factorization keeps from planning.
pub(super) struct Plan {
    pub(super) scalars: Vec<u32>,
    pub(super) placements: Vec<Placement>,
    pub(super) diagonal: Vec<usize>,
    pub(super) columns: SymbolicSparseColMat<u32>,
    pub(super) symbolic: SymbolicSupernodalCholesky<u32>,
}

/// A stored block seen in the permuted lower triangle.
struct Permuted {
    /// Position of its row in the elimination order; not below that of its column.
    row: usize,
    block: usize,
    transposed: bool,
}

impl Plan {
    /// Plans for the elimination order `order`, whose inverse is `position`.
    pub(super) fn new(
        pattern: &BlockPattern,
        order: &[u32],
        position: &[u32],
    ) -> Result<Self, FaerError> {
        let count = pattern.block_count();
        let size = |k: usize| pattern.sizes()[order[k] as usize];
        let mut offsets = vec![0usize; count + 1];
        for k in 0..count {
            offsets[k + 1] = offsets[k] + size(k);
        }
        let scalars = order
            .iter()
            .flat_map(|&block| {
                let start = pattern.offset(block as usize) as u32;
                start..start + pattern.sizes()[block as usize] as u32
            })
            .collect();
        let by_column = permuted_columns(pattern, position);
        let mut placements = vec![Placement::default(); pattern.stored_block_count()];
        let mut diagonal = vec![0usize; pattern.dimension()];
        let (mut starts, mut rows) = (vec![0u32], Vec::new());
        for (k, column) in by_column.iter().enumerate() {
            let height = column.iter().map(|entry| size(entry.row)).sum();
            let strip = rows.len();
            let mut below = strip;
            for entry in column {
                placements[entry.block] =
                    Placement { start: below, stride: height, transposed: entry.transposed };
                below += size(entry.row);
            }
            for c in 0..size(k) {
                diagonal[pattern.offset(order[k] as usize) + c] = strip + c * height + c;
                for entry in column {
                    rows.extend(offsets[entry.row] as u32..offsets[entry.row + 1] as u32);
                }
                starts.push(rows.len() as u32);
            }
        }
        let symbolic = fill(&by_column, &offsets)?;
        let dimension = pattern.dimension();
        let columns = SymbolicSparseColMat::new_checked(dimension, dimension, starts, None, rows);
        Ok(Self { scalars, placements, diagonal, columns, symbolic })
    }
}

/// The stored blocks by permuted block column, rows ascending (the diagonal block first).
fn permuted_columns(pattern: &BlockPattern, position: &[u32]) -> Vec<Vec<Permuted>> {
    let mut columns: Vec<Vec<Permuted>> = (0..position.len()).map(|_| Vec::new()).collect();
    for i in 0..position.len() {
        for (block, &j) in pattern.row_range(i).zip(pattern.row(i)) {
            let (p, q) = (position[i] as usize, position[j as usize] as usize);
            let transposed = p < q;
            columns[p.min(q)].push(Permuted { row: p.max(q), block, transposed });
        }
    }
    for column in &mut columns {
        column.sort_unstable_by_key(|entry| entry.row);
    }
    columns
}

/// faer's symbolic supernodal factor of the permuted matrix.
///
/// The analysis follows paths in the elimination tree from each entry (i, k) of the upper triangle
/// up to k. The scalars of one block form a path there, so the entry in the first row of a block
/// stands for the entries under it, and only first rows are handed over.
fn fill(
    by_column: &[Vec<Permuted>],
    offsets: &[usize],
) -> Result<SymbolicSupernodalCholesky<u32>, FaerError> {
    let count = by_column.len();
    let dimension = offsets[count];
    // By block row now: which earlier blocks of at least one scalar meet it.
    let mut earlier: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (k, column) in by_column.iter().enumerate() {
        for entry in column.iter().filter(|_| offsets[k + 1] > offsets[k]) {
            earlier[entry.row].push(offsets[k] as u32);
        }
    }
    let (mut starts, mut rows) = (vec![0u32], Vec::new());
    for k in 0..count {
        for _ in offsets[k]..offsets[k + 1] {
            rows.extend_from_slice(&earlier[k]);
            starts.push(rows.len() as u32);
        }
    }
    let upper = SymbolicSparseColMatRef::new_checked(dimension, dimension, &starts, None, &rows);
    let scratch = simplicial::prefactorize_symbolic_cholesky_scratch::<u32>(dimension, rows.len())
        .or(supernodal::factorize_supernodal_symbolic_cholesky_scratch::<u32>(dimension));
    let mut memory = MemBuffer::try_new(scratch)?;
    let stack = MemStack::new(&mut memory);
    let (mut tree, mut heights) = (vec![0i32; dimension], vec![0u32; dimension]);
    let tree = simplicial::prefactorize_symbolic_cholesky(&mut tree, &mut heights, upper, stack);
    supernodal::factorize_supernodal_symbolic_cholesky(
        upper,
        tree,
        &heights,
        stack,
        SymbolicSupernodalParams::default(),
    )
}
