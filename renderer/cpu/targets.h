// The instruction sets that the tiles are compiled for. Comes before Highway's headers.
#pragma once

// Vectors of a size that is unknown to the compiler cannot be members of a struct. The oldest sets are left out where a
// newer one is as common. HWY_SCALAR has no half of a vector.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV | HWY_SSSE3 | HWY_SCALAR)
// Compilers count AES among AVX2 only if it is named; the tiles do not encrypt.
#define HWY_DISABLE_PCLMUL_AES
// Processors without SSE4 get what Highway makes of plain C++. It declares that broken for GCC before 12.3, which
// multiplies 16-bit integers wrongly in loops (GCC's bug 106322). The tiles multiply none.
#define HWY_BROKEN_EMU128 0
