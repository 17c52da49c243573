{# A plan as a compute shader: Equation 1 over a window. Rendered by src/backend/shader.rs. -#}
{%- let tiled = loads.is_tiled() %}
struct Params {
    // Width and height of the region that `near` holds.
    region: vec2<i32>,
    // Where in it the pixels to be filtered begin,
    origin: vec2<i32>,
    // and how many columns and rows of them there are.
    size: vec2<i32>,
    // The position of the first of them in `result`.
    first: u32,
    // Always 0, which the compiler must not know.
    zero: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
{%- for line in near_doc %}
// {{ line }}
{%- endfor %}
@group(0) @binding(1) var<storage, read> near: array<{% if loads.is_planar() %}f32{% else %}vec4<f32>{% endif %}>;
{%- if own_quads > 0 %}
{%- for line in own_doc %}
// {{ line }}
{%- endfor %}
@group(0) @binding(2) var<storage, read> own: array<vec4<f32>>;
{%- endif %}
{%- if tap_table %}
// What depends on the offset alone: {{ tap_quads }} per tap, row by row.
@group(0) @binding(3) var<storage, read> taps: array<vec4<f32>>;
{%- endif %}
// Per pixel{% if weights > 1 %} and weight{% endif %}: the filtered colour, and 1 where it was kept as it is.
@group(0) @binding(4) var<storage, read_write> result: array<vec4<f32>>;

const RADIUS: i32 = {{ radius }};
const DILATION: i32 = {{ dilation }};
{%- if tiled %}
// The strip of `near` that a workgroup's row of the window needs.
const COLUMNS: i32 = {{ columns }};
const STRIP: u32 = {{ strip }}u;
var<workgroup> strip: array<vec4<f32>, {{ strip * near_quads }}>;
{%- endif %}
{{ functions }}
{%- if at_i.len() > 0 %}
// What is read at pixel i, the one being filtered.
struct AtI {
{%- for field in at_i %}
    {{ field }}: f32,
{%- endfor %}
}
{% endif %}
{%- if at_j.len() > 0 %}
// What is read at pixel j, the neighbour.
struct AtJ {
{%- for field in at_j %}
    {{ field }}: f32,
{%- endfor %}
}
{% endif %}
{%- if tap.len() > 0 %}
// What depends on the offset from i to j alone.
struct Tap {
{%- for field in tap %}
    {{ field }}: f32,
{%- endfor %}
}
{% endif %}
{%- if !tap_table && tap.len() > 0 %}
fn tap_of(offset: vec2<f32>) -> Tap {
    {%- if !tap_lines.is_empty() %}
    {{ tap_lines|indent(4) }}
    {%- endif %}
    return Tap({{ tap_results }});
}
{% endif %}
{%- if per_pixel.len() > 0 %}
// What is computed once per pixel i.
struct PerPixel {
{%- for field in per_pixel %}
    {{ field }}: f32,
{%- endfor %}
}

fn per_pixel_of({% if at_i.len() > 0 %}i: AtI{% endif %}) -> PerPixel {
    {%- if !pixel_lines.is_empty() %}
    {{ pixel_lines|indent(4) }}
    {%- endif %}
    return PerPixel({{ pixel_results }});
}
{% endif %}
// w(i, j){% if weights > 1 %}, of several filters{% endif %}
fn weight({{ signature }}) -> {{ weight_type }} {
    {%- if !pair_lines.is_empty() %}
    {{ pair_lines|indent(4) }}
    {%- endif %}
    return {{ pair_results }};
}

fn is_finite(x: vec3<f32>) -> bool {
    return all((bitcast<vec3<u32>>(x) & vec3<u32>(0x7fffffffu)) < vec3<u32>(0x7f800000u));
}

// Equation 1 for one pixel: the weighted mean, or the noisy colour where the
// weights sum to nothing that can be trusted.
fn resolved(sums: vec4<f32>, magnitude: f32, noisy: vec3<f32>) -> vec4<f32> {
    let trusted = abs(sums.w) >= max({{ trusted_sum }}, {{ trusted_share }} * magnitude);
    let mean = sums.xyz / select(1f, sums.w, trusted);
    if (trusted && is_finite(mean)) {
        return vec4<f32>(mean, 0f);
    }
    return vec4<f32>(noisy, 1f);
}

@compute @workgroup_size({{ workgroup[0] }}, {{ workgroup[1] }})
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
{%- if tiled %}
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) local_index: u32,
    @builtin(workgroup_id) group: vec3<u32>,
{%- endif %}
) {
    let within = vec2<i32>(id.xy);
{%- if tiled %}
    // Every invocation helps to load the strip, those beyond the edge too.
    let wanted = all(within < params.size);
    let at = min(params.origin + within, params.region - vec2<i32>(1));
{%- else %}
    if (any(within >= params.size)) {
        return;
    }
    let at = params.origin + within;
{%- endif %}
{%- if loads.is_planar() %}
    let plane = u32(params.region.x * params.region.y);
{%- endif %}
    let index = params.first + u32(within.y * params.size.x + within.x);
    let here = u32(at.y * params.region.x + at.x);
    {{ read_i|indent(4) }}
{%- if at_i.len() > 0 %}
    let i = AtI({{ i_values }});
{%- endif %}
{%- if per_pixel.len() > 0 %}
    let per_pixel = per_pixel_of({% if at_i.len() > 0 %}i{% endif %});
{%- endif %}

    // The part of the window that lies inside of the region.
    let first = -min(vec2<i32>(RADIUS), at / DILATION);
    let last = min(vec2<i32>(RADIUS), (params.region - vec2<i32>(1) - at) / DILATION);
{%- for k in 0..weights %}
    var sums_{{ k }} = vec4<f32>();
{%- if signed %}
    var magnitude_{{ k }} = 0f;
{%- endif %}
{%- endfor %}
{%- if tiled %}
    let corner = params.origin + vec2<i32>(group.xy) * vec2<i32>({{ workgroup[0] }}, {{ workgroup[1] }})
        - vec2<i32>(RADIUS * DILATION, 0);
    for (var v = -RADIUS; v <= RADIUS; v++) {
        workgroupBarrier();
        for (var k = local_index; k < STRIP; k += {{ workgroup[0] * workgroup[1] }}u) {
            let place = corner + vec2<i32>(i32(k) % COLUMNS, i32(k) / COLUMNS + v * DILATION);
            let inside = clamp(place, vec2<i32>(0), params.region - vec2<i32>(1));
            let source = u32(inside.y * params.region.x + inside.x) * {{ near_quads }}u;
{%- for q in 0..near_quads %}
            strip[k * {{ near_quads }}u + {{ q }}u] = near[source + {{ q }}u];
{%- endfor %}
        }
        workgroupBarrier();
        // All invocations come to the barriers, so rows outside are skipped like this.
        let last_u = select(last.x, first.x - 1, v < first.y || v > last.y);
{%- else %}
    for (var v = first.y; v <= last.y; v++) {
{%- endif %}
{%- for k in 0..weights %}
        var row_{{ k }} = vec4<f32>();
{%- if signed %}
        var row_magnitude_{{ k }} = 0f;
{%- endif %}
{%- endfor %}
        for (var u = first.x; u <= {% if tiled %}last_u{% else %}last.x{% endif %}; u++) {
{%- if tiled %}
            let there = u32(i32(local.y) * COLUMNS + i32(local.x) + (u + RADIUS) * DILATION);
{%- else %}
            let there = u32((at.y + v * DILATION) * params.region.x + at.x + u * DILATION);
{%- endif %}
            {{ read_j|indent(12) }}
{%- if tap.len() > 0 %}
{%- if tap_table %}
            let tap_index = u32((v + RADIUS) * (2 * RADIUS + 1) + u + RADIUS) * {{ tap_quads }}u;
{%- for q in 0..tap_quads %}
            let t{{ q }} = taps[tap_index + {{ q }}u];
{%- endfor %}
            let tap = Tap({{ tap_values }});
{%- else %}
            let tap = tap_of(vec2<f32>(f32(u * DILATION), f32(v * DILATION)));
{%- endif %}
{%- endif %}
{%- if at_j.len() > 0 %}
            let j = AtJ({{ j_values }});
{%- endif %}
            let w = weight({{ arguments }});
{%- for k in 0..weights %}
{%- let w = self.element(k) %}
            row_{{ k }} = fma(vec4<f32>({{ w }}), vec4<f32>({{ color_j }}, 1f), row_{{ k }});
{%- if signed %}
            row_magnitude_{{ k }} += abs({{ w }});
{%- endif %}
{%- endfor %}
        }
{%- for k in 0..weights %}
        sums_{{ k }} += row_{{ k }};
{%- if signed %}
        magnitude_{{ k }} += row_magnitude_{{ k }};
{%- endif %}
{%- endfor %}
    }
{%- if tiled %}
    if (wanted) {
{%- endif %}
{%- for k in 0..weights %}
    {% if tiled %}    {% endif %}result[index{% if weights > 1 %} * {{ weights }}u + {{ k }}u{% endif %}] = resolved(sums_{{ k }}, {% if signed %}magnitude_{{ k }}{% else %}sums_{{ k }}.w{% endif %}, {{ color_i }});
{%- endfor %}
{%- if tiled %}
    }
{%- endif %}
}
