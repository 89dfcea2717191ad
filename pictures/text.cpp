#include "pictures/text.h"

#include <ft2build.h>
#include FT_FREETYPE_H

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "pictures/font_data.h"

namespace splatvol {
namespace {

constexpr double units = 64;  // of FreeType's fixed-point pixels
constexpr char32_t replacement = 0xFFFD;

// Takes the next character off UTF-8 text. Bytes that are no character give the replacement character.
char32_t take_character(std::string_view& text) {
  const auto first = static_cast<unsigned char>(text.front());
  text.remove_prefix(1);
  if (first < 0x80) return first;
  const int more = first >= 0xF0 ? 3 : first >= 0xE0 ? 2 : first >= 0xC0 ? 1 : 0;
  if (more == 0) return replacement;
  char32_t character = first & (0x3Fu >> more);
  for (int i = 0; i < more; ++i) {
    if (text.empty() || (static_cast<unsigned char>(text.front()) & 0xC0) != 0x80) return replacement;
    character = character << 6 | (static_cast<unsigned char>(text.front()) & 0x3F);
    text.remove_prefix(1);
  }
  return character;
}

void blend(vec4& pixel, const dvec3& color, double share) {
  const auto cover = static_cast<float>(share);
  pixel = pixel * (1 - cover) + vec4(vec3(color), 1) * cover;
}

}  // namespace

struct Font::Face {
  FT_Library library = nullptr;
  FT_Face face = nullptr;

  Face() = default;
  Face(const Face&) = delete;
  Face& operator=(const Face&) = delete;
  ~Face() {
    if (face) FT_Done_Face(face);
    if (library) FT_Done_FreeType(library);
  }

  // Calls `use(glyph slot, x)` with each character's drawn glyph and the pixel at which it begins. Returns the end.
  template <class Use>
  double walk(std::string_view text, FT_Int32 flags, const Use& use) const {
    double x = 0;
    FT_UInt before = 0;
    while (!text.empty()) {
      const FT_UInt glyph = FT_Get_Char_Index(face, take_character(text));
      FT_Vector kerning{};
      if (before) FT_Get_Kerning(face, before, glyph, FT_KERNING_UNFITTED, &kerning);
      x += static_cast<double>(kerning.x) / units;
      before = glyph;
      if (FT_Load_Glyph(face, glyph, flags)) continue;
      use(face->glyph, x);
      x += static_cast<double>(face->glyph->advance.x) / units;
    }
    return x;
  }
};

Font::Font(std::unique_ptr<Face> face, double height) : face_(std::move(face)), height_(height) {}
Font::Font(Font&&) noexcept = default;
Font& Font::operator=(Font&&) noexcept = default;
Font::~Font() = default;

Result<Font> Font::create(double height) {
  auto face = std::make_unique<Face>();
  const auto bytes = font_bytes();
  if (FT_Init_FreeType(&face->library) ||
      FT_New_Memory_Face(face->library, bytes.data(), static_cast<FT_Long>(bytes.size()), 0, &face->face))
    return fail(ErrorCode::invalid_data, "the font cannot be read");
  const auto size = static_cast<FT_F26Dot6>(std::max(4.0, height) * units / 1.2);  // lines are 1.2 letters high
  if (FT_Set_Char_Size(face->face, 0, size, 72, 72))
    return fail(ErrorCode::invalid_data, "the font cannot be {} pixels high", height);
  return Font(std::move(face), height);
}

double Font::width(const std::string& text) const {
  return face_->walk(text, FT_LOAD_NO_HINTING, [](FT_GlyphSlot, double) {});
}

void Font::write(Image& image, double left, double baseline, const std::string& text, const dvec3& color) const {
  const int base = static_cast<int>(std::lround(baseline));
  face_->walk(text, FT_LOAD_NO_HINTING | FT_LOAD_RENDER, [&](FT_GlyphSlot glyph, double x) {
    const FT_Bitmap& bitmap = glyph->bitmap;
    const int first = static_cast<int>(std::lround(left + x)) + glyph->bitmap_left;
    for (int row = 0; row < static_cast<int>(bitmap.rows); ++row)
      for (int column = 0; column < static_cast<int>(bitmap.width); ++column) {
        const int px = first + column, py = base - glyph->bitmap_top + row;
        if (px < 0 || py < 0 || px >= image.width || py >= image.height) continue;
        blend(image.at(px, py), color, bitmap.buffer[row * bitmap.pitch + column] / 255.0);
      }
  });
}

}  // namespace splatvol
