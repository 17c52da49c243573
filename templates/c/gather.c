{# A weighted mean over a window. #}
{% extends "c/kernel.c" %}
{% block tables %}
{%- if !runs.is_empty() %}
    /* Taps side by side: columns right of the pixel, rows below it, how many, how far apart. */
    static const int taps[{{ runs.len() }}][4] = {
{%- for run in runs %}
        { {{- run.dx }}, {{ run.dy }}, {{ run.count }}, {{ run.step -}} },
{%- endfor %}
    };
{%- endif %}
{%- if !table.is_empty() %}
    /* What depends on the tap alone. */
    static const float of_tap[{{ table.len() }}][{{ table[0].len() }}] = {
{%- for row in table %}
        { {{- row|join(", ") -}} },
{%- endfor %}
    };
{%- endif %}
{%- endblock %}
{% block pixel %}
{%- for line in at_i %}
            {{ line }}
{%- endfor %}
            float total = 0.0f;{% if signed %} float magnitude = 0.0f;{% endif %}
{%- for mean in means %}
            float sum_{{ loop.index0 }} = 0.0f;
{%- endfor %}
{%- if !runs.is_empty() %}
{%- if !table.is_empty() %}
            int tap = 0;
{%- endif %}
            for (int k = 0; k < {{ runs.len() }}; ++k) {
                const int count = taps[k][2], v = y + taps[k][1];
                float part = 0.0f;{% if signed %} float part_magnitude = 0.0f;{% endif %}
{%- for mean in means %}
                float part_{{ loop.index0 }} = 0.0f;
{%- endfor %}
                if (v < 0 || v >= size[1]) {
{%- if !table.is_empty() %}
                    tap += count;
{%- endif %}
                    continue;
                }
                for (int n = 0; n < count; ++n{% if !table.is_empty() %}, ++tap{% endif %}) {
                    const int u = x + taps[k][0] + n * taps[k][3];
                    if (u < 0 || u >= size[0])
                        continue;
{%- if reads_j %}
                    const size_t j = (size_t)v * (size_t)size[0] + (size_t)u;
{%- endif %}
{%- for line in at_j %}
                    {{ line }}
{%- endfor %}
{%- for line in lines %}
                    {{ line }}
{%- endfor %}
                    const float w = {{ weight }};
                    part += w;
{%- if signed %}
                    part_magnitude += fabsf(w);
{%- endif %}
{%- for mean in means %}
                    part_{{ loop.index0 }} = fmaf({{ mean.weight }}, {{ mean.from }}[j], part_{{ loop.index0 }});
{%- endfor %}
                }
                total += part;
{%- if signed %}
                magnitude += part_magnitude;
{%- endif %}
{%- for mean in means %}
                sum_{{ loop.index0 }} += part_{{ loop.index0 }};
{%- endfor %}
            }
{%- endif %}
            /* The mean; or what was averaged, where the weights sum to nothing that can be trusted. */
            const int trusted = fabsf(total) >= fmaxf({{ least }}, {{ share }} * {% if signed %}magnitude{% else %}total{% endif %}) && isfinite(total);
{%- for mean in means %}
            {{ mean.to }}[i] = {{ name }}_kept(trusted, sum_{{ loop.index0 }} / total{% if mean.squared %} / total{% endif %}, {{ mean.lo }}, {{ mean.hi }}, {{ mean.from }}[i]);
{%- endfor %}
{%- endblock %}
