/* The loop nest of Tamis's machine code around an exported weight function, in a form
   that compilers vectorise: BLOCK pixels side by side, whose sums go through the runs
   of taps in the same order. ASSIGN puts planes in their places; READ_I, READ_J and
   WEIGHT are lines of the export and mean what they mean there. */

struct bench_run {
    int32_t dx, dy;
    uint32_t count;
    int32_t step;
};

enum { CHANNELS = 4, SUMS = CHANNELS + SIGNED };

/* Sums of a stretch of `rows` rows from row `top`: row by row, sum by sum, `width`
   numbers, a multiple of BLOCK. The planes are R, G, B, one (all of them 0 beside the
   image) and those that the weight looks at; pixel (0, 0) is their sample `first`, and
   rows are `stride` samples apart. */
void bench_nest(const float *const *planes, const struct bench_run *runs, size_t count, size_t first,
    size_t stride, int32_t top, int32_t rows, int32_t height, size_t width, float *out)
{
    const float *const channels[CHANNELS] = {planes[0], planes[1], planes[2], planes[3]};
    struct bench_images filled;
    const float *const *plane = planes + CHANNELS;
    ASSIGN
    (void)plane;
    const struct bench_images *const images = &filled;
    for (int32_t y = top; y < top + rows; ++y, out += SUMS * width) {
        for (size_t x = 0; x < width; x += BLOCK) {
            const size_t pixel = first + (size_t)y * stride + x;
            float sums[SUMS][BLOCK] = {{0}};
            for (size_t r = 0; r < count; ++r) {
                const int32_t dy = runs[r].dy;
                if (y + dy < 0 || y + dy >= height)
                    continue;
                float run[SUMS][BLOCK] = {{0}};
                int32_t dx = runs[r].dx;
                for (uint32_t tap = 0; tap < runs[r].count; ++tap, dx += runs[r].step) {
                    const size_t neighbour = pixel + (size_t)((ptrdiff_t)dy * (ptrdiff_t)stride + dx);
                    VECTORISE
                    for (int k = 0; k < BLOCK; ++k) {
                        const size_t here = pixel + (size_t)k, there = neighbour + (size_t)k;
                        (void)here;
                        READ_I
                        READ_J
                        WEIGHT
                        for (int c = 0; c < CHANNELS; ++c)
                            run[c][k] = fmaf(w, channels[c][there], run[c][k]);
                        if (SIGNED)
                            run[SUMS - 1][k] = fmaf(fabsf(w), channels[CHANNELS - 1][there], run[SUMS - 1][k]);
                    }
                }
                for (int c = 0; c < SUMS; ++c)
                    for (int k = 0; k < BLOCK; ++k)
                        sums[c][k] += run[c][k];
            }
            for (int c = 0; c < SUMS; ++c)
                memcpy(out + (size_t)c * width + x, sums[c], sizeof sums[c]);
        }
    }
}
