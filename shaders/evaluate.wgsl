{# A tape, evaluated element by element. Rendered by src/backend/gpu/evaluate.rs. -#}
struct Params {
    count: u32,
    // Always 0, which the compiler must not know.
    zero: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// {{ inputs }} inputs, one after the other: all elements of the first, of the second, …
@group(0) @binding(1) var<storage, read> inputs: array<f32>;
@group(0) @binding(2) var<storage, read_write> results: array<f32>;
{{ functions }}
@compute @workgroup_size({{ workgroup }})
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = id.x;
    if (n >= params.count) {
        return;
    }
    {{ lines|indent(4) }}
{%- for result in results %}
    results[{{ loop.index0 }}u * params.count + n] = {{ result }};
{%- endfor %}
}
