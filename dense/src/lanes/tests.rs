//! Each operation in each class, against the plain one.

use super::*;

/// Each operation on awkward numbers.
struct All<'a>(&'a [f32; WIDTH], &'a [f32; WIDTH], &'a [u64]);

impl Kernel for All<'_> {
    type Output = Vec<[u32; WIDTH]>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let mut out: Vec<[u32; WIDTH]> = Vec::new();
        l.prefetch(self.0);
        let (a, b) = (l.load(self.0), l.load(self.1));
        let (i, j) = (l.truncate(a), l.round(b));
        let nan = l.splat(f32::NAN);
        let floats = [
            l.add(a, b),
            l.sub(a, b),
            l.mul(a, b),
            l.fma(a, b, a),
            l.fnma(a, b, a),
            l.div(a, b),
            l.of_bits(l.shift_down::<1>(l.to_bits(a))),
            l.min(a, b),
            l.max(a, b),
            l.select(l.less(a, b), a, b),
            l.select(l.at_most(a, b), b, a),
            l.abs(a),
            l.float(i),
            l.min(a, nan),
            l.min(nan, a),
            l.max(a, nan),
            l.max(nan, a),
            l.select(l.less(a, nan), a, b),
            l.select(l.at_most(nan, a), a, b),
        ];
        for v in floats {
            let mut x = [0.0; WIDTH];
            l.store(v, &mut x);
            out.push(x.map(f32::to_bits));
        }
        let mask = l.above_int(i, j);
        let (always, never) = (l.at_most(a, a), l.less(a, a));
        // Some indices are behind the end, some negative.
        let (all_low, all_high) = l.gather(self.2, j, always);
        let (none_low, none_high) = l.gather(&[], j, always);
        let (low, high) = l.gather(self.2, j, l.but_not(l.differ_int(i, j), mask));
        let whole = [
            i,
            j,
            l.add_int(i, j),
            l.sub_int(i, j),
            l.mul_int(i, j),
            l.min_int(i, j),
            l.max_int(i, j),
            l.and_int(i, j),
            l.or_int(i, j),
            l.shift_up::<8>(j),
            l.shift_down::<3>(j),
            l.shift_down_signed::<3>(j),
            l.select_int(mask, i, j),
            l.select_int(l.below_int(i, j), i, j),
            l.select_int(l.both(mask, l.less(a, b)), i, j),
            l.select_int(l.either(mask, l.less(a, b)), i, j),
            low,
            high,
            l.color_difference(low, high),
            all_low,
            all_high,
            l.color_difference(all_low, all_high),
            none_low,
            none_high,
            l.splat_int(-7),
        ];
        for v in whole {
            let mut bytes = [[0; 4]; WIDTH];
            l.store_bytes(v, &mut bytes);
            assert_eq!(bits(l, l.load_bytes(&bytes)), bytes.map(u32::from_le_bytes));
            out.push(bytes.map(u32::from_le_bytes));
            let mut pairs = [0; WIDTH];
            l.store_pairs(v, i, &mut pairs);
            out.push(pairs.map(|pair| pair as u32));
            out.push(pairs.map(|pair| (pair >> 32) as u32));
        }
        let (mut signed, mut unsigned) = ([0_i16; WIDTH], [0_u16; WIDTH]);
        l.store_i16(i, &mut signed);
        l.store_u16(j, &mut unsigned);
        out.push(bits(l, l.load_i16(&signed)));
        out.push(bits(l, l.load_u16(&unsigned)));
        let colors = std::array::from_fn(|k| [k as u8, 100 + k as u8, 255 - k as u8]);
        out.push(bits(l, l.load_colors(&colors)));
        for mask in [mask, always, never] {
            let two = [u32::from(l.any(mask)), u32::from(l.all(mask))];
            out.push(two.repeat(8).try_into().unwrap());
        }
        out
    }
}

fn bits<L: Lanes>(l: L, v: L::I) -> [u32; WIDTH] {
    let mut bytes = [[0; 4]; WIDTH];
    l.store_bytes(v, &mut bytes);
    bytes.map(u32::from_le_bytes)
}

#[test]
fn all_classes_give_the_same_bits() {
    let a = [0.0, -0.0, 1.5, 2.5, -2.5, -0.3, 7.9, 1e6, -1e6, 0.5, 3.0, 4.0, 5.0, 6.0, 12.0, 13.0];
    let b = [1.0, 2.0, 0.5, 1.5, 3.5, -0.7, 2.0, 99.0, -5.0, 0.5, 1e4, 4.0, 5.4, 6.6, 0.1, 14.0];
    let table: Vec<u64> = (0..100).map(|i| 0x0123_4567_89ab_cdef_u64.rotate_left(i)).collect();
    let reference = run(Class::Scalar, All(&a, &b, &table));
    for class in Class::ALL {
        if class.is_available() {
            assert_eq!(run(class, All(&a, &b, &table)), reference, "{class:?}");
        } else if cfg!(target_arch = "x86_64") && class != Class::Neon {
            // Classes of another architecture are tested where a build is for it.
            covis_solvers::testing::skip(&format!("no {class:?} here"));
        }
    }
}
