{# A mean by equal weights: sums down the columns, and then means of these along the rows. #}
{% extends "program/kernel.wgsl" %}
{% block pixel %}
{%- for k in 0..channels.len() %}
    var sum_{{ k }} = 0f;
{%- endfor %}
{%- if rows %}
    var columns = 0f;
    for (var u = -{{ radius }}; u <= {{ radius }}; u++) {
        let x = at.x + u * {{ dilation }};
        if (x < 0 || x >= size.x) {
            continue;
        }
        columns += 1f;
        let there = u32(at.y * size.x + x);
{%- for channel in channels %}
        sum_{{ loop.index0 }} += {{ channel.0 }} + there];
{%- endfor %}
    }
    let above = min({{ radius }}, at.y / {{ dilation }});
    let below = min({{ radius }}, (size.y - 1 - at.y) / {{ dilation }});
    let count = columns * f32(above + below + 1);
{%- for (from, to, lo, hi) in channels %}
    planes[{{ to }} + place] = clamp(sum_{{ loop.index0 }} / count, {{ lo }}, {{ hi }});
{%- endfor %}
{%- else %}
    for (var v = -{{ radius }}; v <= {{ radius }}; v++) {
        let y = at.y + v * {{ dilation }};
        if (y < 0 || y >= size.y) {
            continue;
        }
        let there = u32(y * size.x + at.x);
{%- for channel in channels %}
        sum_{{ loop.index0 }} += {{ channel.0 }} + there];
{%- endfor %}
    }
{%- for (from, to, lo, hi) in channels %}
    planes[{{ to }} + place] = sum_{{ loop.index0 }};
{%- endfor %}
{%- endif %}
{%- endblock %}
