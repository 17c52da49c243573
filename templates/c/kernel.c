{# A kernel over all pixels of a grid. -#}
/* {{ doc }} */
static void {{ function }}(const struct {{ name }}_run *run)
{
{%- block tables %}{% endblock %}
    const int *const size = run->{{ size }};
{%- for pointer in pointers %}
    {{ pointer }};
{%- endfor %}
{%- block loops %}
    {{ upper }}_ROWS
    for (int y = 0; y < size[1]; ++y) {
        for (int x = 0; x < size[0]; ++x) {
            const size_t i = (size_t)y * (size_t)size[0] + (size_t)x;
{%- block pixel %}{% endblock %}
        }
    }
{%- endblock %}
}
