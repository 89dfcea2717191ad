// Whether tests run under sanitizers, where everything takes five times as long.
#pragma once

namespace splatvol::test {

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SPLATVOL_SANITIZED
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SPLATVOL_SANITIZED
#endif

/// Tests take smaller inputs then. What they check about results, they check on the whole inputs without sanitizers.
#ifdef SPLATVOL_SANITIZED
inline constexpr bool is_sanitized = true;
#else
inline constexpr bool is_sanitized = false;
#endif

}  // namespace splatvol::test
