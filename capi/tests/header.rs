//! The header is what the sources say.

use std::path::{Path, PathBuf};
use std::process::Command;

fn own(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// The header as the sources have it.
fn generated() -> String {
    let config = cbindgen::Config::from_file(own("cbindgen.toml")).expect("a configuration");
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in ["types", "device", "filter", "calls/device", "calls/filter"] {
        builder = builder.with_src(own(&format!("src/{source}.rs")));
    }
    let mut text = Vec::new();
    builder.generate().expect("the sources make a header").write(&mut text);
    String::from_utf8(text).expect("a header is text")
}

/// `TAMIS_UPDATE_HEADER=1 cargo test -p tamis-capi --test header` writes it anew.
#[test]
fn the_header_is_that_of_the_sources() {
    let (path, generated) = (own("include/tamis.h"), generated());
    if std::env::var_os("TAMIS_UPDATE_HEADER").is_some_and(|value| value != "0") {
        std::fs::write(&path, &generated).expect("the header can be written");
    }
    let committed = std::fs::read_to_string(&path).expect("there is a header");
    assert!(
        committed == generated,
        "capi/include/tamis.h is not what the sources say; write it anew with \
         TAMIS_UPDATE_HEADER=1 cargo test -p tamis-capi --test header"
    );
}

/// C99 and C++ take the header alone, without a warning.
#[test]
fn c99_and_cpp_take_the_header_without_a_warning() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("tamis.h"), generated()).expect("written");
    for (compiler, standard, file) in
        [("cc", "c99", "alone.c"), ("cc", "c11", "alone.c"), ("c++", "c++11", "alone.cpp")]
    {
        let source = folder.path().join(file);
        std::fs::write(&source, "#include \"tamis.h\"\nint x = TAMIS_VERSION;\n").expect("written");
        let mut command = Command::new(compiler);
        command.args(["-fsyntax-only", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
        command.arg(format!("-std={standard}")).arg("-I").arg(folder.path()).arg(&source);
        let output = command
            .output()
            .unwrap_or_else(|error| panic!("`{compiler}` cannot be started ({error}): install it"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{compiler} -std={standard}:\n{said}");
    }
}

/// Every function that the sources export is documented in the header.
#[test]
fn every_function_is_documented() {
    let header = generated();
    let mut documented = false;
    let mut functions = 0;
    for line in header.lines() {
        if line.contains(" tamis") && line.contains('(') && !line.starts_with([' ', '/', '*']) {
            assert!(documented, "{line}");
            functions += 1;
        }
        documented = line.trim() == "*/";
    }
    assert!(functions >= 25, "only {functions} functions found");
}
