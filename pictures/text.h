// Words on pictures, in DejaVu Sans, which is part of the program.
#pragma once

#include <memory>
#include <string>

#include "base/error.h"
#include "pictures/image.h"

namespace splatvol {

/// A font of one size. Not thread-safe.
class Font {
 public:
  /// `height`: pixels from one line to the next, at least 4.
  [[nodiscard]] static Result<Font> create(double height);
  Font(Font&&) noexcept;
  Font& operator=(Font&&) noexcept;
  ~Font();

  /// Returns the pixels that a line of UTF-8 text takes from left to right.
  [[nodiscard]] double width(const std::string& text) const;

  /// Writes a line of UTF-8 text over the image; `left` and `baseline` are pixels from the upper left corner. Parts
  /// outside of the image are left out. Characters that the font lacks appear as boxes.
  void write(Image& image, double left, double baseline, const std::string& text, const dvec3& color) const;

  [[nodiscard]] double height() const { return height_; }

 private:
  struct Face;
  Font(std::unique_ptr<Face> face, double height);
  std::unique_ptr<Face> face_;
  double height_;
};

}  // namespace splatvol
