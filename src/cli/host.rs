//! `tamis inspect --host`: what machine code can be made for this processor.

use super::error::Error;

#[cfg(not(feature = "jit"))]
pub(super) fn report(_: bool) -> Result<String, Error> {
    Err(Error::NoMachineCode {
        reason: "the program was built without the feature `jit`".to_owned(),
    })
}

/// What `--lanes` can ask for here.
#[cfg(feature = "jit")]
#[derive(serde::Serialize)]
struct Entry {
    bits: usize,
    lanes: usize,
    generator: &'static str,
    needs: &'static str,
    /// Why not, if it cannot be had.
    lacking: Option<String>,
    chosen: bool,
}

#[cfg(feature = "jit")]
#[derive(serde::Serialize)]
struct Host {
    architecture: &'static str,
    threads: usize,
    /// Instructions that code of 128 bits has to make of others.
    emulated: Vec<&'static str>,
    vectors: Vec<Entry>,
}

/// Lists the widths of vectors, and which of them `--lanes auto` takes.
#[cfg(feature = "jit")]
pub(super) fn report(as_json: bool) -> Result<String, Error> {
    use crate::backend::{Jit, Width};
    use crate::report::score::json;
    use crate::report::{Align, Format, Table};

    let chosen = Jit::new().map(|jit| jit.width()).ok();
    let entry = |width: Width| Entry {
        bits: width.bits(),
        lanes: width.lanes(),
        generator: width.generator(),
        needs: width.needs(),
        lacking: Jit::with_width(width).err().map(|why| why.to_string()),
        chosen: chosen == Some(width),
    };
    let host = Host {
        architecture: std::env::consts::ARCH,
        threads: rayon::current_num_threads(),
        emulated: Jit::with_width(Width::Bits128).map_or(Vec::new(), |jit| jit.emulated()),
        vectors: Width::ALL.map(entry).into(),
    };
    if as_json {
        return Ok(json(&host));
    }
    let columns = [
        ("BITS", Align::Right),
        ("LANES", Align::Right),
        ("MADE BY", Align::Left),
        ("", Align::Left),
    ];
    let mut table = Table::new(columns);
    for entry in &host.vectors {
        let remark = match &entry.lacking {
            Some(why) => why.clone(),
            None if entry.chosen => {
                format!("chosen: the widest that this processor has ({})", entry.needs)
            }
            None => format!("possible ({})", entry.needs),
        };
        let (bits, lanes) = (entry.bits.to_string(), entry.lanes.to_string());
        table.row([bits, lanes, entry.generator.to_owned(), remark]);
    }
    let threads = crate::report::number::plural(host.threads, "thread");
    let table = table.render(Format::Plain);
    let emulated = match host.emulated.as_slice() {
        [] => String::new(),
        names => format!(
            "This processor lacks instructions, which 128 bits make of others, to the same bits \
             in more time: {}\n",
            names.join(", ")
        ),
    };
    Ok(format!("{}, {threads}; vectors of machine code:\n{table}{emulated}", host.architecture))
}
