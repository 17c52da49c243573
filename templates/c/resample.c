{# A plane on the other grid. #}
{% extends "c/kernel.c" %}
{% block pixel %}
{%- if let Some(value) = value %}
            {{ to }}[i] = {{ value }};
{%- else if is_half %}
            const float a = {{ from }}[{{ name }}_at(run->size, 2 * x, 2 * y)];
            const float b = {{ from }}[{{ name }}_at(run->size, 2 * x + 1, 2 * y)];
            const float c = {{ from }}[{{ name }}_at(run->size, 2 * x, 2 * y + 1)];
            const float d = {{ from }}[{{ name }}_at(run->size, 2 * x + 1, 2 * y + 1)];
            {{ to }}[i] = 0.25f * ((a + b) + (c + d));
{%- else %}
            /* Between the nearest pixels of half the resolution, a quarter of the way. */
            const int u = x / 2, v = y / 2;
            const int beside = u + (x % 2 ? 1 : -1), other = v + (y % 2 ? 1 : -1);
            const float nearest = {{ name }}_quarter({{ from }}[{{ name }}_at(run->half_size, u, v)],
                {{ from }}[{{ name }}_at(run->half_size, u, other)]);
            const float farther = {{ name }}_quarter({{ from }}[{{ name }}_at(run->half_size, beside, v)],
                {{ from }}[{{ name }}_at(run->half_size, beside, other)]);
            {{ to }}[i] = {{ name }}_quarter(nearest, farther);
{%- endif %}
{%- endblock %}
