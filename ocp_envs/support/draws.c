/* A whole number below n from each of many generators of NumPy, as numpy.random.Generator.integers(n) draws it: by
Lemire's method, "Fast random integer generation in an interval" (2019), on 32 bits. */

#include <stdint.h>

/* The beginning of bitgen_t in numpy/random/bitgen.h. */
typedef struct {
  void *state;
  uint64_t (*next_uint64)(void *state);
  uint32_t (*next_uint32)(void *state);
} generator;

void draw(long long rows, generator *const *generators, long long n, long long *drawn) {
  const uint32_t limit = (uint32_t)n, least = (uint32_t)-limit % limit;
  for (long long row = 0; row < rows; ++row) {
    const generator *g = generators[row];
    uint64_t product;
    do product = (uint64_t)g->next_uint32(g->state) * limit;
    while ((uint32_t)product < least);
    drawn[row] = (long long)(product >> 32);
  }
}
