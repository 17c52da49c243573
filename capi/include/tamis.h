/* Tamis: analytic filters for the noise of Monte Carlo renders.

   C99 and C++. Generated from the library's sources; do not change it.

   A device (what runs filters, and on how many threads) has filters, and a filter has images in
   the caller's memory and parameters:

       TamisDevice device = tamisNewDevice(TAMIS_DEVICE_TYPE_DEFAULT);
       tamisCommitDevice(device);

       TamisFilter filter = tamisNewFilter(device, "RT");
       tamisSetSharedFilterImage(filter, "color",  color,  TAMIS_FORMAT_FLOAT3, width, height, 0, 0, 0);
       tamisSetSharedFilterImage(filter, "albedo", albedo, TAMIS_FORMAT_FLOAT3, width, height, 0, 0, 0);
       tamisSetSharedFilterImage(filter, "normal", normal, TAMIS_FORMAT_FLOAT3, width, height, 0, 0, 0);
       tamisSetSharedFilterImage(filter, "output", output, TAMIS_FORMAT_FLOAT3, width, height, 0, 0, 0);
       tamisCommitFilter(filter);

       tamisExecuteFilter(filter);
       const char *message;
       if (tamisGetDeviceError(device, &message) != TAMIS_ERROR_NONE)
           fprintf(stderr, "%s\n", message);

       tamisReleaseFilter(filter);
       tamisReleaseDevice(device);

   What is set takes effect with the next commit. Functions, formats, error codes and parameters
   are those of Open Image Denoise as far as they mean something here; docs/embedding.md says what
   differs.

   Errors. A function that fails does nothing, returns NULL, 0 or false, tells the device's error
   function, and leaves an error for its thread, which tamisGetDeviceError takes. The first one is
   kept. Unknown names are errors that list the known ones.

   Threads. Any function may be called from any thread. Several threads may use a device, and
   filters of one device may be executed at the same time; each thread has errors of its own. A
   filter is used by one thread at a time: a call that finds another one at work on the filter
   fails with TAMIS_ERROR_INVALID_OPERATION, and so do calls from the filter's own progress
   monitor.

   Pointers. A handle is NULL, which is an error, or one that a function of this library returned
   and whose references were not all given back. Texts that are handed in end with a zero byte and
   are UTF-8. From the call of tamisExecuteFilter until its return the images' memory can be read
   (that of `output` written to), nobody else writes to it, and nobody else uses that of `output`.

   Texts. A text that a function returns belongs to the library, and stays until the same thread
   has been given 16 others or ends, whatever becomes of its device.

   Memory. If the system has no memory left for planes, the process ends, as Rust programs do. */


#ifndef TAMIS_H
#define TAMIS_H


#include <stdbool.h>
#include <stddef.h>

/**
 * The version of the library: 10000 times the major, plus 100 times the minor, plus the patch
 * number.
 */
#define TAMIS_VERSION 100

/**
 * What runs filters. Several threads may use one at a time.
 */
struct TamisDeviceImpl;

/**
 * A filter of a device. One thread uses it at a time; a call that finds another one at it fails.
 */
struct TamisFilterImpl;

/**
 * A device: what runs filters, and on how many threads. Several threads may use one.
 */
typedef struct TamisDeviceImpl *TamisDevice;

/**
 * What runs filters: one of `TAMIS_DEVICE_TYPE_...`.
 */
typedef int TamisDeviceType;

/**
 * What went wrong: one of `TAMIS_ERROR_...`.
 */
typedef int TamisError;

/**
 * Is told of every error of a device, on the thread whose call failed, before the call returns.
 * `message` is a text of the library, which stays until this function returns. It may call this
 * library, and must neither throw nor jump out.
 */
typedef void (*TamisErrorFunction)(void *userPtr, TamisError code, const char *message);

/**
 * A filter: images, parameters, and the code that was made for them. One thread uses it at a
 * time.
 */
typedef struct TamisFilterImpl *TamisFilter;

/**
 * What a pixel of an image is: one of `TAMIS_FORMAT_...`. The numbers are those of Open Image
 * Denoise.
 */
typedef int TamisFormat;

/**
 * Is told which share of the work is done, `n` from 0 to 1, and returns whether to go on. It is
 * called from any thread of the device, but by one thread at a time, and `n` only grows. It may
 * call this library for other filters, and must neither throw nor jump out.
 */
typedef bool (*TamisProgressMonitorFunction)(void *userPtr, double n);

/**
 * How good a result has to be: one of `TAMIS_QUALITY_...`. The numbers are those of Open Image
 * Denoise.
 */
typedef int TamisQuality;

/**
 * The processor, by machine code.
 */
#define TAMIS_DEVICE_TYPE_DEFAULT 0

/**
 * The processor, by machine code.
 */
#define TAMIS_DEVICE_TYPE_CPU 1

/**
 * A GPU, through Vulkan, Metal or Direct3D 12.
 */
#define TAMIS_DEVICE_TYPE_GPU 2

/**
 * A GPU if there is one that is no program itself, with the processor behind it.
 */
#define TAMIS_DEVICE_TYPE_AUTO 3

/**
 * Nothing went wrong.
 */
#define TAMIS_ERROR_NONE 0

/**
 * Something else, a mistake of this library included.
 */
#define TAMIS_ERROR_UNKNOWN 1

/**
 * An argument makes no sense: a handle or a pointer is NULL, a name is unknown, a size, a
 * format or a value is out of its range.
 */
#define TAMIS_ERROR_INVALID_ARGUMENT 2

/**
 * The function cannot be called now: something is not committed, an image is missing, or
 * another call is using the filter.
 */
#define TAMIS_ERROR_INVALID_OPERATION 3

/**
 * There is too little memory on the GPU.
 */
#define TAMIS_ERROR_OUT_OF_MEMORY 4

/**
 * This computer does not have the device that was asked for.
 */
#define TAMIS_ERROR_UNSUPPORTED_HARDWARE 5

/**
 * The progress monitor returned false.
 */
#define TAMIS_ERROR_CANCELLED 6

/**
 * No format: it is refused.
 */
#define TAMIS_FORMAT_UNDEFINED 0

/**
 * One number of 32 bits.
 */
#define TAMIS_FORMAT_FLOAT 1

/**
 * Two numbers of 32 bits.
 */
#define TAMIS_FORMAT_FLOAT2 2

/**
 * Three numbers of 32 bits.
 */
#define TAMIS_FORMAT_FLOAT3 3

/**
 * Four numbers of 32 bits.
 */
#define TAMIS_FORMAT_FLOAT4 4

/**
 * One number of 16 bits (IEEE 754 binary16).
 */
#define TAMIS_FORMAT_HALF 257

/**
 * Two numbers of 16 bits.
 */
#define TAMIS_FORMAT_HALF2 258

/**
 * Three numbers of 16 bits.
 */
#define TAMIS_FORMAT_HALF3 259

/**
 * Four numbers of 16 bits.
 */
#define TAMIS_FORMAT_HALF4 260

/**
 * The filter `tamis`.
 */
#define TAMIS_QUALITY_DEFAULT 0

/**
 * The filter `tamis-fast`: about two thirds of the time, and some more error.
 */
#define TAMIS_QUALITY_FAST 4

/**
 * The filter `tamis`.
 */
#define TAMIS_QUALITY_BALANCED 5

/**
 * The filter `tamis`: there is no better one.
 */
#define TAMIS_QUALITY_HIGH 6

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the library that is loaded, as `TAMIS_VERSION` is that of this header.
 */
int tamisGetVersion(void);

/**
 * Makes a device with one reference, which `tamisReleaseDevice` gives back. It can be used once
 * it is committed. Returns NULL if there is no such type (`TAMIS_ERROR_INVALID_ARGUMENT`, which
 * `tamisGetDeviceError(NULL, ...)` gives).
 */
TamisDevice tamisNewDevice(TamisDeviceType type);

/**
 * Adds a reference to a device. Does nothing for NULL.
 */
void tamisRetainDevice(TamisDevice device);

/**
 * Gives a reference to a device back. A device goes with its last reference; each of its
 * filters has one. Does nothing for NULL.
 */
void tamisReleaseDevice(TamisDevice device);

/**
 * Sets a switch of a device. There is one, `setAffinity`, which is accepted without effect:
 * threads are never bound to cores.
 */
void tamisSetDeviceBool(TamisDevice device, const char *name, bool value);

/**
 * Sets a number of a device. No result depends on them.
 *
 * - `numThreads`: from 1 to 4096, or 0 (the default) for as many as the processor has.
 * - `gpuMemoryMB`: the memory for buffers on a GPU, in MiB, at least 1; the default is 1024.
 *   Images that need more are filtered in tiles.
 */
void tamisSetDeviceInt(TamisDevice device, const char *name, int value);

/**
 * Sets a text of a device.
 *
 * - `backend`: what runs filters, instead of what the device's type says: `jit` (machine code),
 *   `interp` (the interpreter: the same bits, more slowly), `gpu`, `auto`, or `exact` (what
 *   filters mean, in double precision, in hundreds of times the time).
 * - `gpu`: which GPU, if one is used: its index or a part of its name; "" for the best one.
 * - `precision`: `standard` (the default; within 1e-5 of the exact colour) or `fast` (1e-4).
 */
void tamisSetDeviceString(TamisDevice device, const char *name, const char *value);

/**
 * A number of a device: `numThreads` or `gpuMemoryMB` as it was set, or `version`, the library's. Returns 0 if
 * there is no such number.
 */
int tamisGetDeviceInt(TamisDevice device,
                      const char *name);

/**
 * A text of a device that is committed: `backend`, what runs filters, or `remarks`, a line for
 * each thing that there is to say of it: which GPU was taken, why none was, that one failed.
 * Returns NULL if there is no such text. See the top for how long
 * texts stay.
 */
const char *tamisGetDeviceString(TamisDevice device, const char *name);

/**
 * Sets who is told of every error of the device and of its filters; NULL for nobody. Takes
 * effect at once.
 */
void tamisSetDeviceErrorFunction(TamisDevice device, TamisErrorFunction function, void *userPtr);

/**
 * Takes the first error of this thread's calls that it did not ask for yet, and returns its
 * code; `TAMIS_ERROR_NONE` if there is none. With NULL for the device it takes that of calls
 * that had no device: which got NULL for one, or for a filter, or failed to make one.
 *
 * If `outMessage` is not NULL, it gets the message, or NULL if there is no error. See the
 * top for how long texts stay.
 */
TamisError tamisGetDeviceError(TamisDevice device, const char **outMessage);

/**
 * Makes what was set take effect: opens the back end and starts the threads. It has to be called
 * before the first filter is made, and after every change before the next filter is made or
 * committed. `TAMIS_ERROR_UNSUPPORTED_HARDWARE`: this computer does not have the device.
 */
void tamisCommitDevice(TamisDevice device);

/**
 * Makes a filter of a committed device, with one reference, which `tamisReleaseFilter` gives
 * back. Returns NULL if that fails.
 *
 * `type` is `RT` for the best filter that ships (see the parameter `quality`); the name of a
 * filter (`tamis`, `tamis-fast`, `tamis-formula`, ...); the path of a filter file; or a weight as
 * an expression.
 */
TamisFilter tamisNewFilter(TamisDevice device, const char *type);

/**
 * Adds a reference to a filter. Does nothing for NULL.
 */
void tamisRetainFilter(TamisFilter filter);

/**
 * Gives a reference to a filter back. A filter goes with its last reference. Does nothing for
 * NULL.
 */
void tamisReleaseFilter(TamisFilter filter);

/**
 * Sets an image of a filter, which stays in the caller's memory. That is used whenever the
 * filter is executed, until the image is set anew or unset.
 *
 * `name` says what it is; all are linear, row by row from the top, in the renderer's units:
 *
 * - `color`: the noisy colour, 3 components. Required.
 * - `output`: where the result goes, 3 components. Required. It may be `color`, and overlap any
 *   image: everything is read before anything is written.
 * - `albedo`: the albedo of what is seen, from 0 to 1, 3 components.
 * - `normal`: shading normals of length 1, in the world or in the camera, 3 components.
 * - `depth`: the distance from the camera, in any unit, 1 component.
 * - `position`: the position of what is seen in the world, 3 components.
 * - `direct`: direct light, 3 components.
 * - `secondaryAlbedo`: the albedo seen through reflections, from 0 to 1, 3 components.
 * - `alpha`: how much of the pixel is covered, from 0 to 1, 1 component. Where that and the
 *   colour are 0, the result is.
 * - `colorVariance`: the variance of the pixel's mean (the samples' variance divided by their
 *   number), 3 components.
 * - `albedoVariance`, `normalVariance`, `depthVariance`, `positionVariance`, `directVariance`,
 *   `secondaryAlbedoVariance`: the same of another image, averaged over its components, 1
 *   component.
 *
 * Filters read what they know of these, and estimate variances that are not set. `format` may
 * have more components than are used: others are not read, and of `output` not written. Images
 * need no alignment.
 *
 * - `devPtr`: the memory, not NULL.
 * - `width`, `height`: pixels per row, and rows; the same for all images of a filter.
 * - `byteOffset`: from `devPtr` to the first pixel.
 * - `pixelByteStride`: from a pixel to the next, at least a pixel's size; 0 if nothing lies
 *   between them.
 * - `rowByteStride`: from a row to the next, at least a row's size; 0 if nothing lies between
 *   them.
 */
void tamisSetSharedFilterImage(TamisFilter filter,
                               const char *name,
                               void *devPtr,
                               TamisFormat format,
                               size_t width,
                               size_t height,
                               size_t byteOffset,
                               size_t pixelByteStride,
                               size_t rowByteStride);

/**
 * Removes an image of a filter, if it has it. Names are those of `tamisSetSharedFilterImage`.
 */
void tamisUnsetFilterImage(TamisFilter filter, const char *name);

/**
 * Sets a switch of a filter.
 *
 * - `hdr`: whether the result may be above 1. The default is true (Open Image Denoise's is
 *   false); with false it is cut off at 1.
 * - `srgb`: whether `color` and `output` are encoded by the sRGB curve, from 0 to 1: the colour
 *   is decoded, filtered and encoded. The default is false. `colorVariance` cannot be set then.
 * - `cleanAux`: accepted without effect. How noisy albedo, normals and the others are is read
 *   from their variances, or estimated.
 */
void tamisSetFilterBool(TamisFilter filter, const char *name, bool value);

/**
 * Sets a whole number of a filter.
 *
 * - `quality`: one of `TAMIS_QUALITY_...`; which filter `RT` is. A filter that was chosen by
 *   its name stays.
 * - `samples`: how many samples each pixel is the mean of, or 0 (the default) if that is not
 *   known. Clean images gain by it.
 * - `maxMemoryMB`: accepted without effect; -1 (the default) or more. Filters use their memory
 *   again row by row; a GPU's is the device's `gpuMemoryMB`.
 */
void tamisSetFilterInt(TamisFilter filter, const char *name, int value);

/**
 * Sets a number of a filter.
 *
 * - `strength`: how much of the result is taken, from 0 to 1 (the default); the rest is the
 *   noisy colour.
 * - `inputScale`: accepted without effect. Filters follow the exposure: a colour that is twice
 *   as bright has a result that is.
 */
void tamisSetFilterFloat(TamisFilter filter, const char *name, float value);

/**
 * Sets a text of a filter.
 *
 * - `filter`: what `tamisNewFilter` takes as the type.
 * - `repair`: what becomes of pixels that are no numbers, or beyond 1e18: `median` (the default)
 *   replaces each by the median around it, `error` refuses the image, `none` leaves them.
 */
void tamisSetFilterString(TamisFilter filter, const char *name, const char *value);

/**
 * A switch of a filter as it was set: `hdr`, `srgb` or `cleanAux`. Returns false if there is no
 * such switch.
 */
bool tamisGetFilterBool(TamisFilter filter, const char *name);

/**
 * A whole number of a filter: `quality`, `samples` or `maxMemoryMB` as it was set, or
 * `keptPixels`: how many pixels kept what was to be averaged in the latest execution, because no
 * pixel around them counts; each is counted once per mean that the filter takes. Returns 0 if
 * there is no such number, or nothing was executed yet.
 */
int tamisGetFilterInt(TamisFilter filter, const char *name);

/**
 * A number of a filter: `strength` or `inputScale` as it was set, or what the latest execution
 * took in seconds: `preparingSeconds` (images are read and features derived), `planningSeconds`
 * and `compilationSeconds` (0 where the code was there already), `filteringSeconds`. Returns 0
 * if there is no such number, or nothing was executed yet.
 */
float tamisGetFilterFloat(TamisFilter filter, const char *name);

/**
 * A text of a filter: `filter`, the name of what is computed; or of the latest execution:
 * `notes`, a line for each thing that there is to say (pixels that were repaired, variances that
 * were estimated), and `backend`, what ran it. Returns NULL if there is no such text, or nothing
 * was executed yet. See the top for how long texts stay.
 */
const char *tamisGetFilterString(TamisFilter filter, const char *name);

/**
 * Sets who is told how far an execution is and says whether to go on; NULL for nobody. Takes
 * effect at once. An execution that is told to stop ends with `TAMIS_ERROR_CANCELLED` and writes
 * nothing.
 */
void tamisSetFilterProgressMonitorFunction(TamisFilter filter,
                                           TamisProgressMonitorFunction function,
                                           void *userPtr);

/**
 * Makes images and parameters that were set take effect. It has to be called before the first
 * execution, and after every change before the next one. What is wrong with them together is
 * `TAMIS_ERROR_INVALID_OPERATION`: `color`, `output` or an image that the filter cannot do without
 * is missing, or sizes differ.
 */
void tamisCommitFilter(TamisFilter filter);

/**
 * Filters the images. Returns when the result is written; if it fails, nothing is written. The
 * first execution compiles the filter for what is known of the images: which are set, and the
 * range of values of each. Later ones use the code again as long as that is the same.
 *
 * `TAMIS_ERROR_INVALID_OPERATION`: the filter is not committed, or an image cannot be used.
 * `TAMIS_ERROR_CANCELLED`: the progress monitor asked to stop.
 */
void tamisExecuteFilter(TamisFilter filter);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* TAMIS_H */
