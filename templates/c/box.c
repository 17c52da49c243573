{# A mean by equal weights. #}
{% extends "c/kernel.c" %}
{% block tables %}
    const int radius = {{ radius }}, step = {{ step }};
{%- endblock %}
{% block loops %}
    /* Sums down the columns, */
    {{ upper }}_ROWS
    for (int y = 0; y < size[1]; ++y) {
        for (int x = 0; x < size[0]; ++x) {
            const size_t i = (size_t)y * (size_t)size[0] + (size_t)x;
{%- for mean in means %}
            float sum_{{ loop.index0 }} = 0.0f;
{%- endfor %}
            for (int k = -radius; k <= radius; ++k) {
                const int v = y + k * step;
                if (v < 0 || v >= size[1])
                    continue;
                const size_t j = (size_t)v * (size_t)size[0] + (size_t)x;
{%- for mean in means %}
                sum_{{ loop.index0 }} += {{ mean.from }}[j];
{%- endfor %}
            }
{%- for mean in means %}
            {{ mean.columns }}[i] = sum_{{ loop.index0 }};
{%- endfor %}
        }
    }
    /* and of these along the rows. */
    {{ upper }}_ROWS
    for (int y = 0; y < size[1]; ++y) {
        float rows = 0.0f;
        for (int k = -radius; k <= radius; ++k)
            rows += y + k * step >= 0 && y + k * step < size[1] ? 1.0f : 0.0f;
        for (int x = 0; x < size[0]; ++x) {
            const size_t i = (size_t)y * (size_t)size[0] + (size_t)x;
            float columns = 0.0f;
{%- for mean in means %}
            float sum_{{ loop.index0 }} = 0.0f;
{%- endfor %}
            for (int k = -radius; k <= radius; ++k) {
                const int u = x + k * step;
                if (u < 0 || u >= size[0])
                    continue;
                const size_t j = (size_t)y * (size_t)size[0] + (size_t)u;
                columns += 1.0f;
{%- for mean in means %}
                sum_{{ loop.index0 }} += {{ mean.columns }}[j];
{%- endfor %}
            }
{%- for mean in means %}
            const float mean_{{ loop.index0 }} = sum_{{ loop.index0 }} / (columns * rows);
            {{ mean.to }}[i] = mean_{{ loop.index0 }} < {{ mean.lo }} ? {{ mean.lo }} : mean_{{ loop.index0 }} > {{ mean.hi }} ? {{ mean.hi }} : mean_{{ loop.index0 }};
{%- endfor %}
        }
    }
{%- endblock %}
