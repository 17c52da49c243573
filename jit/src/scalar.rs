//! The meaning of [`Lanes`], as a program: one lane, evaluated while "emitted".
//!
//! This is the reference that compiled code is held to, bit for bit. It is
//! written for reading, not for speed.

use crate::lanes::{Lanes, Side};

/// One pixel pair: evaluates a [`Body`](crate::Body) on plain `f32` values.
///
/// ```
/// use tamis_jit::{Lanes, Scalar, Side};
///
/// let mut pair = Scalar { i: &[3.0], j: &[5.0], tap: &[0.5] };
/// let (near, far, factor) = (pair.plane(0, Side::I), pair.plane(0, Side::J), pair.tap(0));
/// let difference = pair.sub(far, near);
/// assert_eq!(pair.mul(difference, factor), 1.0);
/// ```
///
/// # Panics
///
/// Reading a plane or a tap value that the slices lack panics.
#[derive(Clone, Copy, Debug)]
pub struct Scalar<'a> {
    /// The value of every plane at pixel i.
    pub i: &'a [f32],
    /// The value of every plane at its neighbour j.
    pub j: &'a [f32],
    /// The uniform values of the tap that leads from i to j.
    pub tap: &'a [f32],
}

impl Lanes for Scalar<'_> {
    type F = f32;
    type M = bool;

    fn constant(&mut self, value: f32) -> f32 {
        value
    }

    fn plane(&mut self, index: usize, side: Side) -> f32 {
        match side {
            Side::I => self.i[index],
            Side::J => self.j[index],
        }
    }

    fn tap(&mut self, index: usize) -> f32 {
        self.tap[index]
    }

    fn neg(&mut self, x: f32) -> f32 {
        -x
    }

    fn abs(&mut self, x: f32) -> f32 {
        x.abs()
    }

    fn sqrt(&mut self, x: f32) -> f32 {
        x.sqrt()
    }

    fn round(&mut self, x: f32) -> f32 {
        x.round_ties_even()
    }

    fn exp2i(&mut self, x: f32) -> f32 {
        f32::from_bits((x + 12_583_039.0).to_bits() << 23)
    }

    fn exponent(&mut self, x: f32) -> f32 {
        (x.to_bits().wrapping_sub(0x3f35_04f4) as i32 >> 23) as f32
    }

    fn fraction(&mut self, x: f32) -> f32 {
        f32::from_bits((x.to_bits().wrapping_sub(0x3f35_04f4) & 0x007f_ffff) + 0x3eb5_04f4)
    }

    fn add(&mut self, x: f32, y: f32) -> f32 {
        x + y
    }

    fn sub(&mut self, x: f32, y: f32) -> f32 {
        x - y
    }

    fn mul(&mut self, x: f32, y: f32) -> f32 {
        x * y
    }

    fn div(&mut self, x: f32, y: f32) -> f32 {
        x / y
    }

    fn min(&mut self, x: f32, y: f32) -> f32 {
        if x < y { x } else { y }
    }

    fn max(&mut self, x: f32, y: f32) -> f32 {
        if x > y { x } else { y }
    }

    fn fma(&mut self, x: f32, y: f32, z: f32) -> f32 {
        x.mul_add(y, z)
    }

    fn lt(&mut self, x: f32, y: f32) -> bool {
        x < y
    }

    fn select(&mut self, mask: bool, x: f32, y: f32) -> f32 {
        if mask { x } else { y }
    }
}
