/* Programs over lanes: so many are computed side by side, number by number in rows. Loops over all of them become vectors, in
   functions of their own, as compilers then know that their rows are apart. */
#include <stdlib.h>
enum { LANES = 64 };
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
/* The same operations on as many lanes at once as the processor can; without contraction their results are the same. */
#define CLONES __attribute__((target_clones("avx512f", "avx2", "default"), noinline))
#else
#define CLONES
#endif

CLONES static void fetch(double *restrict x, const double *restrict in, long step, long count) {
    if (step == 0)
        for (long k = 0; k < LANES; k++) x[k] = *in;
    else if (step == 1 && count == LANES)
        for (long k = 0; k < LANES; k++) x[k] = in[k];
    else
        for (long k = 0; k < count; k++) x[k] = in[k * step];
}
CLONES static void fetch_plane(double *restrict re, double *restrict im, const double *restrict in, long step, long count) {
    if (step == 0)
        for (long k = 0; k < LANES; k++) re[k] = in[0], im[k] = in[1];
    else if (step == 2 && count == LANES)
        for (long k = 0; k < LANES; k++) re[k] = in[2 * k], im[k] = in[2 * k + 1];
    else
        for (long k = 0; k < count; k++) re[k] = in[k * step], im[k] = in[k * step + 1];
}
CLONES static void store_plane(double *restrict out, const double *restrict re, const double *restrict im, long count) {
    if (count == LANES)
        for (long k = 0; k < LANES; k++) out[2 * k] = re[k], out[2 * k + 1] = im[k];
    else
        for (long k = 0; k < count; k++) out[2 * k] = re[k], out[2 * k + 1] = im[k];
}
