// Whether the system has threads.
#pragma once

namespace splatvol {

#ifdef __EMSCRIPTEN__
#define SPLATVOL_ONE_THREAD 1
#else
#define SPLATVOL_ONE_THREAD 0
#endif
inline constexpr bool has_threads = SPLATVOL_ONE_THREAD == 0;

}  // namespace splatvol
