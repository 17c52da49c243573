{# A plane on the other grid. -#}
/* {{ doc }} */
static void {{ function }}(const struct {{ name }}_run *run)
{
    const int *const size = run->{{ size }};
{%- for pointer in pointers %}
    {{ pointer }};
{%- endfor %}
    {{ upper }}_ROWS
    for (int y = 0; y < size[1]; ++y) {
        for (int x = 0; x < size[0]; ++x) {
            const size_t i = (size_t)y * (size_t)size[0] + (size_t)x;
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
        }
    }
}
