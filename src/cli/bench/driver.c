/* The program around an exported kernel: reads its images once, then filters them
   on request. Each request is one character on stdin: `r` runs the filter and
   prints the nanoseconds that it took, `w` writes R, G and B and prints 0. */

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { MOST_THREADS = 1024, STRIP = 4 };

static struct bench_images images;
static float *out[3];
static int next_row;

static void *filter_rows(void *unused)
{
    (void)unused;
    for (;;) {
        const int first = __atomic_fetch_add(&next_row, STRIP, __ATOMIC_RELAXED);
        if (first >= images.height)
            return NULL;
        for (int y = first; y < first + STRIP && y < images.height; ++y) {
            for (int x = 0; x < images.width; ++x) {
                const size_t here = (size_t)y * (size_t)images.width + (size_t)x;
                float rgb[3];
                bench_pixel(&images, x, y, rgb);
                for (int c = 0; c < 3; ++c)
                    out[c][here] = rgb[c];
            }
        }
    }
}

static int filter_all(int threads)
{
    static pthread_t others[MOST_THREADS];
    int started = 0;
    next_row = 0;
    while (started < threads - 1 && started < MOST_THREADS) {
        if (pthread_create(&others[started], NULL, filter_rows, NULL))
            return 0;
        ++started;
    }
    filter_rows(NULL);
    while (started > 0)
        pthread_join(others[--started], NULL);
    return 1;
}

static long long now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec * 1000000000LL + time.tv_nsec;
}

/* Arguments: the images' file, their width, height and number, threads, the
   result's file. */
int main(int argc, char **argv)
{
    if (argc != 7)
        return 2;
    const int width = atoi(argv[2]), height = atoi(argv[3]), threads = atoi(argv[5]);
    const size_t pixels = (size_t)width * (size_t)height;
    const size_t samples = (size_t)atoi(argv[4]) * pixels;
    float *given = (float *)malloc(samples * sizeof(float));
    FILE *file = fopen(argv[1], "rb");
    if (!given || !file || fread(given, sizeof(float), samples, file) != samples)
        return 3;
    fclose(file);
    for (int c = 0; c < 3; ++c) {
        out[c] = (float *)calloc(pixels, sizeof(float));
        if (!out[c])
            return 3;
    }
    images.width = width;
    images.height = height;
    {
        const float *image = given;
        ASSIGN
    }
    for (;;) {
        const int request = getchar();
        long long took = 0;
        if (request == 'r') {
            const long long start = now();
            if (!filter_all(threads))
                return 4;
            took = now() - start;
        } else if (request == 'w') {
            FILE *result = fopen(argv[6], "wb");
            if (!result)
                return 5;
            for (int c = 0; c < 3; ++c)
                if (fwrite(out[c], sizeof(float), pixels, result) != pixels)
                    return 5;
            if (fclose(result))
                return 5;
        } else {
            return 0;
        }
        printf("%lld\n", took);
        fflush(stdout);
    }
}
