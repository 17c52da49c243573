/* How many numbers `scratch` must have room for; 0 for an image that is empty or too large. */
size_t {{ name }}_scratch(size_t width, size_t height)
{
    const size_t largest = (size_t)1 << 24; /* the greatest coordinate that is a float */
    const size_t planes = {{ upper }}_FULL_PLANES + {{ upper }}_HALF_PLANES + 3;
    if (width == 0 || height == 0 || width > largest || height > largest)
        return 0;
    if (width > (size_t)-1 / sizeof(float) / planes / (height + 1))
        return 0;
    return {{ upper }}_FULL_PLANES * width * height +
        {{ upper }}_HALF_PLANES * ((width + 1) / 2) * ((height + 1) / 2) + 1;
}

/* Filters an image of width * height pixels into `rgb`: R, G and B of each, row by row from
   the top left. `scratch` has {{ name }}_scratch(width, height) numbers, which need not be set.
   `rgb` and `scratch` must not overlap each other or the inputs. Returns 0; or 1 if the size
   is not accepted, or 2 if a pointer is null: then nothing is written. */
int {{ name }}_filter(size_t width, size_t height, const struct {{ name }}_inputs *in, float *rgb, float *scratch)
{
    struct {{ name }}_run run;
    if ({{ name }}_scratch(width, height) == 0)
        return 1;
    if (!in || !rgb || !scratch)
        return 2;
{%- for image in images %}
    if (!in->{{ image }})
        return 2;
{%- endfor %}
    run.in = in;
    run.size[0] = (int)width;
    run.size[1] = (int)height;
    run.half_size[0] = (int)((width + 1) / 2);
    run.half_size[1] = (int)((height + 1) / 2);
    run.planes = scratch;
{%- for kernel in kernels %}
    {{ kernel }}(&run);
{%- endfor %}
    for (size_t i = 0; i < width * height; ++i) {
{%- for output in outputs %}
        rgb[3 * i + {{ loop.index0 }}] = {{ output }} * in->exposure;
{%- endfor %}
    }
    return 0;
}
