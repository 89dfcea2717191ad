// Pictures out of programs for node.
#pragma once

#include <cstdio>
#include <memory>
#include <string>

#include "base/error.h"
#include "pictures/image.h"

namespace splatvol {

/// Writes the pixels of a picture: linear premultiplied RGBA, as 32-bit floats, the upper row first.
[[nodiscard]] inline Status write_pixels(const std::string& path, const Image& image) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "wb"), &std::fclose);
  const std::size_t count = image.pixels.size();
  if (!file || std::fwrite(image.pixels.data(), sizeof(vec4), count, file.get()) != count)
    return fail(ErrorCode::io, "{}: cannot write", path);
  return {};
}

}  // namespace splatvol
