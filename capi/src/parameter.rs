//! The parameters of filters: numbers and switches by name.

use std::ffi::c_int;

use crate::error::Failure;
use crate::types::{
    TAMIS_QUALITY_BALANCED, TAMIS_QUALITY_DEFAULT, TAMIS_QUALITY_FAST, TAMIS_QUALITY_HIGH,
    TamisQuality,
};

/// The parameters of a filter, with what they mean to Tamis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Parameters {
    /// Whether the result may be above 1.
    pub(crate) hdr: bool,
    /// Whether colour and result are encoded.
    pub(crate) srgb: bool,
    pub(crate) quality: TamisQuality,
    /// Samples per pixel, 0 if nobody says.
    pub(crate) samples: c_int,
    /// How much of the result is taken.
    pub(crate) strength: f32,
    /// Without effect: features' noise is estimated, or read from their variances.
    clean_aux: bool,
    /// Without effect: filters follow the exposure.
    input_scale: f32,
    /// Without effect: planes are used again row by row.
    max_memory: c_int,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            hdr: true,
            srgb: false,
            quality: TAMIS_QUALITY_DEFAULT,
            samples: 0,
            strength: 1.0,
            clean_aux: false,
            input_scale: f32::NAN,
            max_memory: -1,
        }
    }
}

/// What C calls the kinds of parameters, and the functions for them.
pub(crate) const BOOL: &str = "Bool";
pub(crate) const INT: &str = "Int";
pub(crate) const FLOAT: &str = "Float";
pub(crate) const STRING: &str = "String";

impl Parameters {
    pub(crate) fn bools(&mut self) -> [(&'static str, &mut bool); 3] {
        [("hdr", &mut self.hdr), ("srgb", &mut self.srgb), ("cleanAux", &mut self.clean_aux)]
    }

    pub(crate) fn ints(&mut self) -> [(&'static str, &mut c_int); 3] {
        [
            ("quality", &mut self.quality),
            ("samples", &mut self.samples),
            ("maxMemoryMB", &mut self.max_memory),
        ]
    }

    pub(crate) fn floats(&mut self) -> [(&'static str, &mut f32); 2] {
        [("strength", &mut self.strength), ("inputScale", &mut self.input_scale)]
    }

    pub(crate) fn set_bool(&mut self, name: &str, value: bool) -> Result<(), Failure> {
        *find(BOOL, self.bools(), name)? = value;
        Ok(())
    }

    pub(crate) fn set_int(&mut self, name: &str, value: c_int) -> Result<(), Failure> {
        let slot = find(INT, self.ints(), name)?;
        let known = match name {
            "quality" => matches!(
                value,
                TAMIS_QUALITY_DEFAULT
                    | TAMIS_QUALITY_FAST
                    | TAMIS_QUALITY_BALANCED
                    | TAMIS_QUALITY_HIGH
            ),
            "samples" => value >= 0,
            _ => value >= -1,
        };
        if !known {
            let range = match name {
                "quality" => "one of TAMIS_QUALITY_DEFAULT (0), FAST (4), BALANCED (5), HIGH (6)",
                "samples" => "the samples per pixel, or 0 if they are not known",
                _ => "a number of MiB, or -1 for no bound",
            };
            return Err(Failure::argument(format!("`{name}` is {value}; it must be {range}")));
        }
        *slot = value;
        Ok(())
    }

    pub(crate) fn set_float(&mut self, name: &str, value: f32) -> Result<(), Failure> {
        let slot = find(FLOAT, self.floats(), name)?;
        if name == "strength" && !(0.0..=1.0).contains(&value) {
            let must = "it must be a number from 0 to 1";
            return Err(Failure::argument(format!("`strength` is {value}; {must}")));
        }
        *slot = value;
        Ok(())
    }
}

/// What has a name, or an error that lists what there is.
pub(crate) fn find<T, const N: usize>(
    kind: &str,
    known: [(&'static str, T); N],
    name: &str,
) -> Result<T, Failure> {
    let names = known.each_ref().map(|(known, _)| *known);
    let found = known.into_iter().find(|(known, _)| *known == name);
    found.map(|(_, found)| found).ok_or_else(|| unknown(kind, name, &names))
}

/// That there is nothing of a name.
pub(crate) fn unknown(kind: &str, name: &str, names: &[&str]) -> Failure {
    let names = names.join(", ");
    Failure::argument(format!("there is no {kind} called `{name}`; there are: {names}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_and_unknown_names_are_refused_and_change_nothing() {
        let mut parameters = Parameters::default();
        for (failure, said) in [
            (parameters.set_int("quality", 3), "one of TAMIS_QUALITY_DEFAULT"),
            (parameters.set_int("samples", -1), "or 0 if they are not known"),
            (parameters.set_int("maxMemoryMB", -2), "or -1"),
            (parameters.set_int("hdr", 1), "no Int called `hdr`; there are: quality, samples"),
            (parameters.set_float("strength", 1.5), "from 0 to 1"),
            (parameters.set_float("strength", f32::NAN), "from 0 to 1"),
            (parameters.set_bool("HDR", true), "there are: hdr, srgb, cleanAux"),
        ] {
            let failure = failure.unwrap_err();
            assert!(failure.message.contains(said), "{failure:?}");
        }
        // NaN is the default of Open Image Denoise's input scale, and equals nothing.
        parameters.input_scale = 0.0;
        let unchanged = Parameters { input_scale: 0.0, ..Parameters::default() };
        assert_eq!(parameters, unchanged);
    }
}
