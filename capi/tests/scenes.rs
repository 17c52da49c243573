//! The C functions give the bits that files get, with every feature that scenes have.
#![cfg(unix)]

mod common;

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_int};
use std::ptr;

use common::{interleaved, raw, scenes};
use tamis::denoise::Denoiser;
use tamis::expr::{Feature, Quantity};
use tamis::scene::RawScene;
use tamis_c::calls::device::{
    tamisCommitDevice, tamisGetDeviceError, tamisNewDevice, tamisReleaseDevice,
};
use tamis_c::calls::filter::{
    tamisCommitFilter, tamisExecuteFilter, tamisGetFilterInt, tamisNewFilter, tamisReleaseFilter,
    tamisSetFilterInt, tamisSetSharedFilterImage,
};
use tamis_c::types::{
    TAMIS_DEVICE_TYPE_DEFAULT, TAMIS_ERROR_NONE, TAMIS_FORMAT_FLOAT, TAMIS_FORMAT_FLOAT3,
};

/// A scene's features under the names that C gives them, with their formats.
fn buffers(raw: &RawScene) -> BTreeMap<String, (c_int, Vec<f32>)> {
    let named = raw.features.iter().map(|(&(feature, quantity), planes)| {
        let term = feature.term();
        match (feature, quantity) {
            (_, Quantity::Value) | (Feature::Color, _) if planes.len() == 3 => {
                let name = if quantity == Quantity::Value { "" } else { "Variance" };
                (format!("{term}{name}"), (TAMIS_FORMAT_FLOAT3, interleaved(planes)))
            }
            (_, Quantity::Value) => (term.to_owned(), (TAMIS_FORMAT_FLOAT, planes[0].clone())),
            // One variance is as good as three of which it is the mean.
            _ => {
                let mean = |k| planes.iter().map(|p| p[k]).sum::<f32>() / planes.len() as f32;
                let mean: Vec<f32> = (0..planes[0].len()).map(mean).collect();
                (format!("{term}Variance"), (TAMIS_FORMAT_FLOAT, mean))
            }
        }
    });
    named.collect()
}

#[test]
fn every_feature_of_every_scene_gives_the_bits_that_its_file_gets() {
    let denoiser = Denoiser::builder().build().expect("the processor is there");
    for path in scenes() {
        let raw = raw(&path);
        let mut buffers = buffers(&raw);
        assert!(buffers.len() > 8 && buffers.contains_key("colorVariance"), "{:?}", buffers.keys());
        let mut out = vec![0.0f32; 3 * raw.width * raw.height];
        // SAFETY: handles are used between their making and their release; the buffers have the
        // sizes that are said, and outlive the filter.
        let kept = unsafe {
            let device = tamisNewDevice(TAMIS_DEVICE_TYPE_DEFAULT);
            tamisCommitDevice(device);
            let filter = tamisNewFilter(device, c"RT".as_ptr());
            let set = |name: &CStr, memory: *mut f32, format| {
                let (width, height) = (raw.width, raw.height);
                let (memory, name) = (memory.cast(), name.as_ptr());
                tamisSetSharedFilterImage(filter, name, memory, format, width, height, 0, 0, 0);
            };
            for (name, (format, samples)) in &mut buffers {
                let name = CString::new(name.as_str()).expect("a name");
                set(&name, samples.as_mut_ptr(), *format);
            }
            set(c"output", out.as_mut_ptr(), TAMIS_FORMAT_FLOAT3);
            let samples = raw.samples.map_or(0, |samples| samples.try_into().expect("few"));
            tamisSetFilterInt(filter, c"samples".as_ptr(), samples);
            tamisCommitFilter(filter);
            tamisExecuteFilter(filter);
            let kept = tamisGetFilterInt(filter, c"keptPixels".as_ptr());
            let mut message = ptr::null();
            let code = tamisGetDeviceError(device, &raw mut message);
            let said = if message.is_null() { c"" } else { CStr::from_ptr(message) };
            assert_eq!(code, TAMIS_ERROR_NONE, "{}: {said:?}", path.display());
            tamisReleaseFilter(filter);
            tamisReleaseDevice(device);
            kept
        };
        let file = denoiser.denoise(&path).expect("it has every feature");
        let expected = interleaved(&file.image().rgb().map(<[f32]>::to_vec));
        assert!(out == expected, "{}", path.display());
        let expected: usize = file.pictures[0].applied.kept.iter().sum();
        assert_eq!(usize::try_from(kept).expect("a count"), expected);
    }
}
