//! Images in the caller's memory.

use std::ffi::c_void;
use std::slice;

use tamis::denoise::{SampleType, Strides, View, ViewMut};

use crate::error::Failure;
use crate::types::{
    TAMIS_FORMAT_FLOAT, TAMIS_FORMAT_FLOAT4, TAMIS_FORMAT_HALF, TAMIS_FORMAT_HALF4, TamisFormat,
};

/// A format's samples, and how many a pixel has.
fn format(format: TamisFormat) -> Option<(SampleType, usize)> {
    match format {
        TAMIS_FORMAT_FLOAT..=TAMIS_FORMAT_FLOAT4 => Some((SampleType::F32, format as usize)),
        TAMIS_FORMAT_HALF..=TAMIS_FORMAT_HALF4 => {
            Some((SampleType::F16, (format - TAMIS_FORMAT_HALF) as usize + 1))
        }
        _ => None,
    }
}

/// How an image lies in memory, as C says it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    pub(crate) format: TamisFormat,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) byte_offset: usize,
    /// Bytes from a pixel to the next, 0 for none between them.
    pub(crate) pixel_stride: usize,
    /// Bytes from a row to the next, 0 for none between them.
    pub(crate) row_stride: usize,
}

/// An image whose memory somebody else has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Image {
    /// Its first pixel.
    start: *mut u8,
    /// From that to the end of its last pixel.
    bytes: usize,
    size: (usize, usize),
    sample: SampleType,
    strides: Strides,
}

// SAFETY: the pointer is followed in `view` and `view_mut` alone, whose callers see to it that
// nobody else uses the memory in the meantime.
unsafe impl Send for Image {}

impl Image {
    /// An image of which so many components are used. `name` is what messages call it.
    pub(crate) fn new(
        name: &str,
        components: usize,
        memory: *mut c_void,
        layout: Layout,
    ) -> Result<Self, Failure> {
        let wrong = |what: String| Err(Failure::argument(format!("{name}: {what}")));
        if memory.is_null() {
            return wrong("its memory is NULL; to remove an image, unset it".to_owned());
        }
        let Some((sample, has)) = format(layout.format) else {
            return wrong(format!(
                "{} is no format; take one of TAMIS_FORMAT_FLOAT (1) to FLOAT4 (4) and \
                 TAMIS_FORMAT_HALF (257) to HALF4 (260)",
                layout.format
            ));
        };
        if has < components {
            return wrong(format!("its pixels have {has} components, but {components} are used"));
        }
        let Layout { width, height, byte_offset, .. } = layout;
        if width == 0 || height == 0 {
            return wrong(format!("{width} x {height} pixels are no image"));
        }
        let of_pixel = has * sample.size();
        let pixel = if layout.pixel_stride == 0 { of_pixel } else { layout.pixel_stride };
        if pixel < of_pixel {
            return wrong(format!("pixels of {of_pixel} bytes cannot lie {pixel} bytes apart"));
        }
        let too_large = || Failure::argument(format!("{name}: it is larger than any memory"));
        let of_row = width.checked_mul(pixel).ok_or_else(too_large)?;
        let row = if layout.row_stride == 0 { of_row } else { layout.row_stride };
        if row < of_row {
            return wrong(format!("rows of {of_row} bytes cannot lie {row} bytes apart"));
        }
        let rows_before = (height - 1).checked_mul(row).ok_or_else(too_large)?;
        let within = (width - 1) * pixel + of_pixel;
        let bytes = rows_before.checked_add(within).ok_or_else(too_large)?;
        // What lies in one piece of memory is at most this large, and ends at an address.
        let end = byte_offset.checked_add(bytes).filter(|&end| isize::try_from(end).is_ok());
        if end.and_then(|end| memory.addr().checked_add(end)).is_none() {
            return Err(too_large());
        }
        let start = memory.cast::<u8>().wrapping_add(byte_offset);
        // Both fit, as all bytes together do.
        let strides = Strides {
            offset: 0,
            pixel: pixel.cast_signed(),
            row: row.min(isize::MAX.cast_unsigned()).cast_signed(),
            component: sample.size().cast_signed(),
        };
        Ok(Self { start, bytes, size: (width, height), sample, strides })
    }

    /// Pixels per row, and rows.
    pub(crate) fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The image, to be read.
    ///
    /// # Safety
    /// From its first pixel to its last one the memory can be read, and nobody writes to it as
    /// long as the view is used.
    pub(crate) unsafe fn view<'a>(&self) -> View<'a> {
        // SAFETY: bytes need no alignment, `new` checked the pointer and the length, and the
        // caller promises the rest.
        let bytes = unsafe { slice::from_raw_parts(self.start, self.bytes) };
        View::strided(bytes, self.sample, self.strides)
    }

    /// The image, to be written.
    ///
    /// # Safety
    /// From its first pixel to its last one the memory can be written to, and nobody else uses it
    /// as long as the view is used: no other view either.
    pub(crate) unsafe fn view_mut<'a>(&self) -> ViewMut<'a> {
        // SAFETY: as in `view`.
        let bytes = unsafe { slice::from_raw_parts_mut(self.start, self.bytes) };
        ViewMut::strided(bytes, self.sample, self.strides)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{TAMIS_FORMAT_FLOAT2, TAMIS_FORMAT_FLOAT3};

    const DENSE: Layout = Layout {
        format: TAMIS_FORMAT_FLOAT3,
        width: 4,
        height: 2,
        byte_offset: 0,
        pixel_stride: 0,
        row_stride: 0,
    };

    fn image(layout: Layout) -> Result<Image, Failure> {
        let mut memory = [0u8; 8];
        Image::new("color", 3, memory.as_mut_ptr().cast(), layout)
    }

    #[test]
    fn strides_of_zero_are_those_of_dense_images() {
        let dense = image(DENSE).expect("it makes sense");
        assert_eq!((dense.bytes, dense.strides.pixel, dense.strides.row), (96, 12, 48));
        let half = Layout { format: TAMIS_FORMAT_HALF4, byte_offset: 5, ..DENSE };
        let half = image(half).expect("it makes sense");
        assert_eq!((half.bytes, half.strides.pixel, half.strides.row), (64, 8, 32));
        let apart = image(Layout { pixel_stride: 20, row_stride: 100, ..DENSE }).expect("wide");
        assert_eq!(apart.bytes, 100 + 3 * 20 + 12);
    }

    #[test]
    fn what_makes_no_image_is_refused() {
        let huge = usize::MAX / 2;
        for (layout, said) in [
            (Layout { format: 0, ..DENSE }, "0 is no format"),
            (Layout { format: 5, ..DENSE }, "5 is no format"),
            (Layout { format: 261, ..DENSE }, "261 is no format"),
            (Layout { format: TAMIS_FORMAT_FLOAT2, ..DENSE }, "have 2 components, but 3"),
            (Layout { width: 0, ..DENSE }, "0 x 2 pixels"),
            (Layout { pixel_stride: 11, ..DENSE }, "12 bytes cannot lie 11"),
            (Layout { row_stride: 47, ..DENSE }, "48 bytes cannot lie 47"),
            (Layout { width: huge, ..DENSE }, "larger than any memory"),
            (Layout { height: huge, ..DENSE }, "larger than any memory"),
            (Layout { row_stride: usize::MAX, ..DENSE }, "larger than any memory"),
            (Layout { byte_offset: usize::MAX - 8, ..DENSE }, "larger than any memory"),
        ] {
            let failure = image(layout).unwrap_err();
            assert!(failure.message.contains(said), "{layout:?}: {failure:?}");
        }
        let nothing = Image::new("color", 3, std::ptr::null_mut(), DENSE).unwrap_err();
        assert!(nothing.message.contains("color: its memory is NULL"), "{nothing:?}");
    }
}
