{# A weighted mean over a window. Sums are made in short runs, so that rounding errors do not add up. #}
{% extends "program/kernel.wgsl" %}
{% block pixel %}
{%- for read in at_i %}
    let {{ read.0 }} = {{ read.1 }} + place];
{%- endfor %}
{%- for k in 0..sums %}
    var sum_{{ k }} = 0f;
{%- endfor %}
    for (var first = {{ first_tap }}u; first < {{ last_tap }}u; first += {{ run }}u) {
{%- for k in 0..sums %}
        var part_{{ k }} = 0f;
{%- endfor %}
        let last = min(first + {{ run }}u, {{ last_tap }}u);
        for (var tap = first; tap < last; tap += {{ stride }}u) {
            let offset = vec2<i32>(i32(taps[tap]), i32(taps[tap + 1u]));
            let other = at + offset;
            // A window ends where the region does.
            if (any(other < vec2<i32>(0)) || any(other >= size)) {
                continue;
            }
            let there = u32(other.y * size.x + other.x);
{%- for read in at_j %}
            let {{ read.0 }} = {{ read.1 }} + there];
{%- endfor %}
            {%- if !lines.is_empty() %}
            {{ lines|indent(12) }}
            {%- endif %}
            let weight = {{ weight }};
{%- for channel in channels %}
            part_{{ loop.index0 }} = fma(weight, {{ channel.0 }} + there], part_{{ loop.index0 }});
{%- endfor %}
            part_{{ total }} += weight;
{%- if signed %}
            part_{{ total + 1 }} += abs(weight);
{%- endif %}
{%- if let Some(variance) = variance %}
            part_{{ sums - 1 }} = fma({{ variance.weight }}, {{ variance.from }} + there], part_{{ sums - 1 }});
{%- endif %}
        }
{%- for k in 0..sums %}
        sum_{{ k }} += part_{{ k }};
{%- endfor %}
    }
    // The mean, or what was averaged where the weights sum to nothing that can be trusted.
    let total = sum_{{ total }};
    let trusted = abs(total) >= max({{ trusted_sum }}, {{ trusted_share }} * {% if signed %}sum_{{ total + 1 }}{% else %}total{% endif %}) && is_finite(total);
    let divisor = select(1f, total, trusted);
{%- for (from, to, lo, hi) in channels %}
    let mean_{{ loop.index0 }} = sum_{{ loop.index0 }} / divisor;
    planes[{{ to }} + place] = select({{ from }} + place], clamp(mean_{{ loop.index0 }}, {{ lo }}, {{ hi }}), trusted && is_finite(mean_{{ loop.index0 }}));
{%- endfor %}
{%- if let Some(variance) = variance %}
    let variance = sum_{{ sums - 1 }} / divisor / divisor;
    planes[{{ variance.to }} + place] = select({{ variance.from }} + place], clamp(variance, {{ variance.lo }}, {{ variance.hi }}), trusted && is_finite(variance));
{%- endif %}
    let pixel = at * {{ step }} - params.origin;
    if (!trusted && all(pixel >= vec2<i32>(0)) && all(pixel < params.wanted)) {
{%- for stage in stages %}
        atomicAdd(&kept[{{ stage }}], 1u);
{%- endfor %}
    }
{%- endblock %}
