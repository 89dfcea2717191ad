#include "pictures/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "base/hypotenuse.h"
#include "pictures/text.h"
#include "pictures/ticks.h"

namespace splatvol {
namespace {

constexpr double text_share = 0.032;  // height of a line, of the shorter side of the page
constexpr double least_text = 9, most_text = 200;

// Lengths round a scalar bar, in lines of text.
constexpr double bar_width = 0.9, tick_length = 0.3, gap = 0.45, bar_lines = 14;

double text_height_for(int width, int height) {
  return std::clamp(text_share * std::min(width, height), least_text, most_text);
}

// The words round a scalar bar, and the pixels that they take.
struct BarText {
  Ticks ticks;
  std::string label;
  double width = 0;
};

BarText bar_text(const Font& font, const PageBar& bar, int ticks) {
  BarText text{ticks_of(bar.function, ticks), bar.label};
  double widest = 0;
  for (const Tick& tick : text.ticks.list) widest = std::max(widest, font.width(tick.label));
  const double line = font.height();
  text.width = std::max((bar_width + tick_length + gap) * line + widest,
                        std::max(font.width(text.label), font.width(text.ticks.factor))) +
               2 * gap * line;
  return text;
}

// Returns the pixels right of the picture and over it.
Result<std::array<int, 2>> margins(const PageText& text, double text_height) {
  SPLATVOL_TRY_ASSIGN(font, Font::create(text_height));
  std::array<int, 2> result{0, 0};
  for (const PageBar& bar : text.bars) result[0] += static_cast<int>(std::ceil(bar_text(font, bar, text.ticks).width));
  if (!text.title.empty()) result[1] = static_cast<int>(std::ceil(1.8 * text_height));
  return result;
}

void fill(Image& image, double left, double top, double right, double bottom, const dvec3& color) {
  const auto at = [](double x, int most) { return std::clamp(static_cast<int>(std::lround(x)), 0, most); };
  for (int y = at(top, image.height); y < at(bottom, image.height); ++y)
    for (int x = at(left, image.width); x < at(right, image.width); ++x) image.at(x, y) = vec4(vec3(color), 1);
}

// `from`: the left end of its words and the space round them.
void draw_bar(Image& image, const Page& page, const Font& font, const BarText& text, const TransferFunction& function,
              double from, const dvec3& ink) {
  const double line = font.height();
  const double left = from + gap * line;
  const double words = (text.ticks.factor.empty() ? 1.6 : 2.8) * line;  // over the bar
  const double length = std::min(bar_lines * line, page.picture_height - words - 2 * line);
  const double top = page.top + 0.5 * (page.picture_height - length + words), bottom = top + length;
  const double thin = std::max(1.0, std::round(line / 14));
  fill(image, left - thin, top - thin, left + bar_width * line + thin, bottom + thin, ink);
  for (int y = static_cast<int>(std::lround(top)); y < static_cast<int>(std::lround(bottom)); ++y) {
    const double t = std::clamp((bottom - y - 0.5) / length, 0.0, 1.0);
    fill(image, left, y, left + bar_width * line, y + 1, function.color_at(t));
  }
  for (const Tick& tick : text.ticks.list) {
    const double y = bottom - function.t_of(tick.value) * length;
    const double right = left + (bar_width + tick_length) * line;
    fill(image, left + bar_width * line, y - 0.5 * thin, right, y + 0.5 * thin, ink);
    font.write(image, right + 0.25 * line, y + 0.3 * line, tick.label, ink);
  }
  font.write(image, left, top - words + line, text.label, ink);
  font.write(image, left, top - words + 2.2 * line, text.ticks.factor, ink);
}

// Returns whether a neighbour of a pixel is not covered.
bool is_at_edge(const Image& words, int x, int y) {
  if (x == 0 || y == 0 || x + 1 == words.width || y + 1 == words.height) return true;
  return std::min({words.at(x - 1, y).a, words.at(x + 1, y).a, words.at(x, y - 1).a, words.at(x, y + 1).a}) < 1;
}

// Puts a soft edge of this width under words and lines.
void add_halo(Image& words, double width, const dvec3& color) {
  const int reach = static_cast<int>(std::ceil(width)) + 1;
  std::vector<float> cover(words.pixels.size(), 0.0F);
  for (int y = 0; y < words.height; ++y)
    for (int x = 0; x < words.width; ++x) {
      const float alpha = words.at(x, y).a;
      if (alpha == 0 || !is_at_edge(words, x, y)) continue;
      for (int v = std::max(y - reach, 0); v <= std::min(y + reach, words.height - 1); ++v)
        for (int u = std::max(x - reach, 0); u <= std::min(x + reach, words.width - 1); ++u) {
          const double share = std::clamp(width + 1 - hypotenuse(u - x, v - y), 0.0, 1.0);
          float& most = cover[static_cast<std::size_t>(v) * words.width + u];
          most = std::max(most, static_cast<float>(share) * alpha);
        }
    }
  for (std::size_t i = 0; i < cover.size(); ++i)
    words.pixels[i] += (1 - words.pixels[i].a) * cover[i] * vec4(vec3(color), 1);
}

}  // namespace

std::string title_with_time(const std::string& title, double time) {
  return fmt::format("{}{}time {:.6g}", title, title.empty() ? "" : ", ", time);
}

Result<Page> lay_out_page(int width, int height, const PageText& text) {
  Page page{width, height, 0, width, height, text_height_for(width, height)};
  if (text.title.empty() && text.bars.empty()) return page;
  SPLATVOL_TRY_ASSIGN(sides, margins(text, page.text_height));
  page.top = sides[1];
  page.picture_width = width - sides[0];
  page.picture_height = height - sides[1];
  if (2 * page.picture_width < width || 2 * page.picture_height < height)
    return fail(ErrorCode::invalid_argument, "{} x {} pixels are too few for a picture beside its title and scalar {}",
                width, height, text.bars.size() > 1 ? "bars" : "bar");
  return page;
}

Result<Image> compose_page(const Page& page, Image picture, const PageText& text, const dvec3& ink, bool halo) {
  if (picture.width != page.picture_width || picture.height != page.picture_height)
    return fail(ErrorCode::invalid_argument, "a picture of {} x {} on a page for {} x {}", picture.width,
                picture.height, page.picture_width, page.picture_height);
  if (text.title.empty() && text.bars.empty() && page.width == picture.width && page.height == picture.height)
    return picture;
  Image words{page.width, page.height, std::vector<vec4>(static_cast<std::size_t>(page.width) * page.height)};
  SPLATVOL_TRY_ASSIGN(font, Font::create(page.text_height));
  if (!text.title.empty())
    font.write(words, std::max(0.0, 0.5 * (page.picture_width - font.width(text.title))), 1.25 * page.text_height,
               text.title, ink);
  double left = page.picture_width;
  for (const PageBar& bar : text.bars) {
    const BarText of = bar_text(font, bar, text.ticks);
    draw_bar(words, page, font, of, bar.function, left, ink);
    left += std::ceil(of.width);
  }
  if (halo) add_halo(words, page.text_height / 8, dvec3(1) - ink);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      vec4& pixel = words.at(x, page.top + y);
      pixel += (1 - pixel.a) * picture.at(x, y);
    }
  return words;
}

}  // namespace splatvol
