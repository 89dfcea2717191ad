#include "pictures/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "pictures/line.h"
#include "pictures/text.h"
#include "pictures/ticks.h"

namespace splatvol {
namespace {

constexpr double text_share = 0.035;  // height of a line, of the shorter side
constexpr double least_text = 9, most_text = 200;
const dvec3 ink(0), faint(0.8);  // linear

// A picture that is being drawn.
struct Sheet {
  const CurvePlot& plot;
  const Font& font;
  Image& image;
  double left, right, top, bottom;  // of the curves' ground, in pixels

  void draw_line(const dvec2& from, const dvec2& to, double width, const dvec3& color) const {
    visit_line({from, to}, width, image.width, image.height, [&](int x, int y, double share) {
      vec4& pixel = image.at(x, y);
      pixel = vec4(vec3(share * color + (1 - share) * dvec3(pixel)), 1);
    });
  }
  [[nodiscard]] double thickness() const { return font.height() / 9; }
};

Ticks ticks_of(const PlotRange& range, int most) {
  if (range.low < range.high) return ticks_between(range.low, range.high, most);
  const double beside = range.low != 0 ? std::abs(range.low) : 1;
  return ticks_between(range.low - beside, range.low + beside, most);
}

PlotRange places_of(const CurvePlot& plot) { return {plot.places.front(), plot.places.back()}; }

double share_in(const PlotRange& range, double value) {
  return range.low < range.high ? (value - range.low) / (range.high - range.low) : 0.5;
}

// Returns the words of a curve.
std::string legend_of(const CurvePlot& plot, std::size_t number) {
  const PlotCurve& curve = plot.curves[number];
  if (plot.has_common_axis) return curve.name;
  const PlotRange range = range_of(curve.values);
  if (range.is_empty()) return curve.name + ": no values";
  const int digits = digits_of_range(range.low, range.high);
  return fmt::format("{}: {:.{}g} to {:.{}g}", curve.name, range.low, digits, range.high, digits);
}

void draw_axes(const Sheet& sheet, const PlotRange& values) {
  const double line = sheet.font.height();
  const Ticks across = ticks_of(places_of(sheet.plot), 6);
  for (const Tick& tick : across.list) {
    const double x = sheet.left + share_in(places_of(sheet.plot), tick.value) * (sheet.right - sheet.left);
    if (x < sheet.left - 0.5 || x > sheet.right + 0.5) continue;
    sheet.draw_line({x, sheet.top}, {x, sheet.bottom}, 1, faint);
    sheet.font.write(sheet.image, x - 0.5 * sheet.font.width(tick.label), sheet.bottom + 1.2 * line, tick.label, ink);
  }
  const std::string name = sheet.plot.place_name + (across.factor.empty() ? "" : ", " + across.factor);
  sheet.font.write(sheet.image, 0.5 * (sheet.left + sheet.right - sheet.font.width(name)), sheet.bottom + 2.5 * line,
                   name, ink);
  if (!sheet.plot.has_common_axis || values.is_empty()) return;
  const Ticks up = ticks_of(values, 6);
  for (const Tick& tick : up.list) {
    const double y = sheet.bottom - share_in(values, tick.value) * (sheet.bottom - sheet.top);
    if (y < sheet.top - 0.5 || y > sheet.bottom + 0.5) continue;
    sheet.draw_line({sheet.left, y}, {sheet.right, y}, 1, faint);
    sheet.font.write(sheet.image, sheet.left - 0.4 * line - sheet.font.width(tick.label), y + 0.3 * line, tick.label,
                     ink);
  }
  sheet.font.write(sheet.image, 0.4 * line, sheet.top - 0.5 * line, up.factor, ink);
}

void draw_curve(const Sheet& sheet, std::size_t number) {
  const std::vector<double>& values = sheet.plot.curves[number].values;
  const PlotRange axis = axis_of_curve(sheet.plot, number);
  const auto point_of = [&](std::size_t row) {
    return dvec2(sheet.left + share_in(places_of(sheet.plot), sheet.plot.places[row]) * (sheet.right - sheet.left),
                 sheet.bottom - share_in(axis, values[row]) * (sheet.bottom - sheet.top));
  };
  const auto rows = rows_of_plot(sheet.plot.places, values, static_cast<std::size_t>(sheet.right - sheet.left));
  for (std::size_t k = 1; k < rows.size(); ++k)
    if (!std::isnan(values[rows[k - 1]] + values[rows[k]]))
      sheet.draw_line(point_of(rows[k - 1]), point_of(rows[k]), sheet.thickness(), color_of_curve(number));
}

void draw_legend(const Sheet& sheet) {
  const double line = sheet.font.height();
  for (std::size_t number = 0; number < sheet.plot.curves.size(); ++number) {
    const double baseline = (1.2 + 1.3 * static_cast<double>(number)) * line;
    const double middle = baseline - 0.3 * line;
    sheet.draw_line({sheet.left, middle}, {sheet.left + 2 * line, middle}, sheet.thickness(), color_of_curve(number));
    sheet.font.write(sheet.image, sheet.left + 2.5 * line, baseline, legend_of(sheet.plot, number), ink);
  }
}

// Returns the pixels that the labels of the axis of values take.
double label_width(const CurvePlot& plot, const Font& font, const PlotRange& values) {
  double widest = 0;
  if (plot.has_common_axis && !values.is_empty())
    for (const Tick& tick : ticks_of(values, 6).list) widest = std::max(widest, font.width(tick.label));
  return widest;
}

}  // namespace

PlotRange PlotRange::with(const PlotRange& other) const {
  return {std::min(low, other.low), std::max(high, other.high)};
}

PlotRange range_of(std::span<const double> values) {
  PlotRange range{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const double value : values)
    if (!std::isnan(value)) range = range.with({value, value});
  return range;
}

std::vector<std::size_t> rows_of_plot(std::span<const double> places, std::span<const double> values,
                                      std::size_t columns) {
  const double first = places.front(), width = places.back() - first;
  const auto column_of = [&](std::size_t row) {
    return width > 0 ? std::floor((places[row] - first) / width * static_cast<double>(columns)) : 0;
  };
  std::vector<std::size_t> rows;
  for (std::size_t begin = 0, end = 0; begin < places.size(); begin = end) {
    std::array<std::size_t, 4> kept{begin, begin, begin, begin};  // least, largest, none, last
    for (end = begin; end < places.size() && column_of(end) == column_of(begin); ++end) {
      if (std::isnan(values[end])) {
        kept[2] = end;
        continue;
      }
      if (!(values[end] >= values[kept[0]])) kept[0] = end;
      if (!(values[end] <= values[kept[1]])) kept[1] = end;
    }
    kept[3] = end - 1;
    rows.push_back(begin);
    std::ranges::sort(kept);
    for (const std::size_t row : kept)
      if (row != rows.back()) rows.push_back(row);
  }
  return rows;
}

dvec3 color_of_curve(std::size_t number) {
  static constexpr std::array<dvec3, 6> colors = {dvec3(0.05, 0.25, 0.75), dvec3(0.85, 0.25, 0.02),
                                                  dvec3(0.05, 0.45, 0.1),  dvec3(0.55, 0.1, 0.55),
                                                  dvec3(0.45, 0.3, 0.05),  dvec3(0.03, 0.45, 0.5)};
  return colors[number % colors.size()];
}

PlotRange axis_of_curve(const CurvePlot& plot, std::size_t number) {
  PlotRange axis = range_of(plot.curves[number].values);
  for (std::size_t other = 0; plot.has_common_axis && other < plot.curves.size(); ++other)
    axis = axis.with(range_of(plot.curves[other].values));
  return axis;
}

Result<Image> draw_plot(const CurvePlot& plot, int width, int height) {
  SPLATVOL_TRY_ASSIGN(font, Font::create(std::clamp(text_share * std::min(width, height), least_text, most_text)));
  const double line = font.height();
  const PlotRange values = axis_of_curve(plot, 0);
  Image image{width, height, {}};
  image.pixels.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), vec4(1));
  const Sheet sheet{.plot = plot,
                    .font = font,
                    .image = image,
                    .left = 1.2 * line + label_width(plot, font, values),
                    .right = width - 1.5 * line,
                    .top = (1.8 + 1.3 * static_cast<double>(plot.curves.size())) * line,
                    .bottom = height - 3.2 * line};
  if (sheet.right - sheet.left < 0.5 * width || sheet.bottom - sheet.top < 0.5 * height)
    return fail(ErrorCode::invalid_argument,
                "{} x {} pixels: the words of the plot leave it less than half: choose more", width, height);
  draw_axes(sheet, values);
  sheet.draw_line({sheet.left, sheet.bottom}, {sheet.right, sheet.bottom}, 1, ink);
  sheet.draw_line({sheet.left, sheet.top}, {sheet.left, sheet.bottom}, 1, ink);
  for (std::size_t number = 0; number < plot.curves.size(); ++number) draw_curve(sheet, number);
  draw_legend(sheet);
  return image;
}

}  // namespace splatvol
