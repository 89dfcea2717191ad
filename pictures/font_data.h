// The bytes of a TrueType font.
#pragma once

#include <span>

namespace splatvol {

/// Returns the file of DejaVu Sans.
[[nodiscard]] std::span<const unsigned char> font_bytes();

}  // namespace splatvol
