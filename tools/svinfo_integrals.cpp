#include "tools/svinfo_integrals.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <thread>

#include "base/json.h"
#include "sampler/integrals.h"
#include "sampler/surface_integrals.h"
#include "tools/plane_options.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

using json = nlohmann::ordered_json;

// Reads a finite number into `number`, or nothing. Returns whether that is all of the text.
bool read_limit(std::string_view text, double& number) {
  if (text.empty()) return true;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size() && std::isfinite(number);
}

// Reads "NAME=A:B". The name may have equals signs.
Result<ValueRange> parse_range(const std::string& text) {
  const std::size_t equals = text.rfind('=');
  const std::size_t colon = equals == std::string::npos ? equals : text.find(':', equals);
  ValueRange range;
  if (equals == 0 || colon == std::string::npos ||
      !read_limit(std::string_view(text).substr(equals + 1, colon - equals - 1), range.low) ||
      !read_limit(std::string_view(text).substr(colon + 1), range.high))
    return fail(ErrorCode::invalid_argument, "'{}' is not a name with a range of values, such as p=0.5:2", text);
  if (!(range.low <= range.high))
    return fail(ErrorCode::invalid_argument, "'{}': the first value must be the lower one", text);
  range.attribute = text.substr(0, equals);
  return range;
}

// Reads "NAME=VALUE". The name may have equals signs.
Result<ContourSurface> parse_contour(const std::string& text) {
  const std::size_t equals = text.rfind('=');
  ContourSurface contour;
  if (equals == 0 || equals == std::string::npos || equals + 1 == text.size() ||
      !read_limit(std::string_view(text).substr(equals + 1), contour.value))
    return fail(ErrorCode::invalid_argument, "'{}' is not a name with a value, such as p=0.5", text);
  contour.attribute = text.substr(0, equals);
  return contour;
}

Result<IntegralRequest> request_of(const IntegralOptions& options, const std::vector<std::string>& attributes) {
  IntegralRequest request{.attributes = attributes};
  if (const std::vector<double>& box = options.box; !box.empty())
    request.box = Box{{box[0], box[1], box[2]}, {box[3], box[4], box[5]}};
  for (const std::string& text : options.clip_planes) {
    SPLATVOL_TRY_ASSIGN(plane, parse_plane(text));
    request.clip_planes.push_back({plane.point, plane.normal});
  }
  for (const std::string& text : options.ranges) {
    SPLATVOL_TRY_ASSIGN(range, parse_range(text));
    request.ranges.push_back(std::move(range));
  }
  return request;
}

Result<Integrals> integrate(const format::Volume& volume, const IntegralOptions& options,
                            const std::vector<std::string>& attributes) {
  SPLATVOL_TRY_ASSIGN(memory, memory_or_quarter(options.memory));
  SPLATVOL_TRY_ASSIGN(request, request_of(options, attributes));
  ProgressBar bar("integrating");
  return integrate_cells(volume, request, memory, std::max(1u, std::thread::hardware_concurrency()),
                         [&](double fraction) { bar.update(fraction); });
}

Result<SurfaceRequest> surface_request_of(const IntegralOptions& options, const std::vector<std::string>& attributes) {
  SurfaceRequest request;
  SPLATVOL_TRY_SET(request.integrals, request_of(options, attributes));
  if (!options.contour.empty()) SPLATVOL_TRY_SET(request.surface, parse_contour(options.contour));
  if (!options.slice.empty()) {
    SPLATVOL_TRY_ASSIGN(plane, parse_plane(options.slice));
    request.surface = HalfSpace{plane.point, plane.normal};
  }
  if (!options.flux.empty()) request.vector = {options.flux + "[0]", options.flux + "[1]", options.flux + "[2]"};
  return request;
}

Result<SurfaceIntegrals> integrate_over_surface(const format::Volume& volume, const IntegralOptions& options,
                                                const std::vector<std::string>& attributes) {
  SPLATVOL_TRY_ASSIGN(memory, memory_or_quarter(options.memory));
  SPLATVOL_TRY_ASSIGN(request, surface_request_of(options, attributes));
  ProgressBar bar("integrating");
  return integrate_surface(volume, request, memory, std::max(1u, std::thread::hardware_concurrency()),
                           [&](double fraction) { bar.update(fraction); });
}

// `size`: "volume" or "area".
json to_json(const ValueIntegral& of, const std::string& size, double with_value, double missing) {
  const auto list_of = [](const dvec3& p) { return json{p.x, p.y, p.z}; };
  return {{"name", of.name},         {"unit", of.unit},
          {size, with_value},        {"missing_" + size, missing},
          {"integral", of.integral}, {"mean", of.mean},
          {"min", of.low},           {"min_at", list_of(of.low_position)},
          {"max", of.high},          {"max_at", list_of(of.high_position)}};
}

json to_json(const SurfaceIntegrals& integrals, const std::string& name) {
  json attributes = json::array();
  for (const SurfaceIntegral& of : integrals.attributes)
    attributes.push_back(to_json(of, "area", of.area, of.missing_area));
  return {{"file", name},
          {"area", integrals.area},
          {"unknown_area", integrals.unknown_area},
          {"enclosed_volume", integrals.enclosed_volume},
          {"flux", integrals.flux},
          {"left_out", integrals.left_out},
          {"attributes", attributes}};
}

json to_json(const Integrals& integrals, const std::string& name) {
  json attributes = json::array();
  for (const Integral& of : integrals.attributes)
    attributes.push_back(to_json(of, "volume", of.volume, of.missing_volume));
  return {{"file", name},
          {"volume", integrals.volume},
          {"unknown_volume", integrals.unknown_volume},
          {"left_out", integrals.left_out},
          {"attributes", attributes}};
}

std::string text_of(const dvec3& p) { return fmt::format("({:.10g}, {:.10g}, {:.10g})", p.x, p.y, p.z); }

// The rows of attributes, and what is left out. `size`: "volume" or "area".
class IntegralTable {
 public:
  explicit IntegralTable(std::string size) : size_(std::move(size)) {}

  void add(const ValueIntegral& of, double with_value, double missing) {
    rows_ += fmt::format("{:<24} {:>17.10g} {:>17.10g} {:>17.10g} {:>17.10g}  {}\n", of.name, of.integral, of.mean,
                         of.low, of.high, of.unit);
    if (with_value > 0)
      places_ +=
          fmt::format("{:<24} min at {}, max at {}\n", of.name, text_of(of.low_position), text_of(of.high_position));
    if (missing > 0)
      missing_ += fmt::format("{:<24} has no value in {} of {:.10g}, which is left out\n", of.name, a_size(), missing);
  }

  void print(double all, double unknown, std::uint64_t left_out) const {
    print_out("{:<24} {:>17} {:>17} {:>17} {:>17}  {}\n{}\n{}{}", "attribute", "integral", "mean", "min", "max", "unit",
              rows_, places_, missing_);
    if (!(all > 0)) print_out("no part of {} is in the region\n", size_ == "area" ? "the surface" : "a cell");
    if (unknown > 0)
      print_out("left out: {} of {:.10g} where an attribute of --range has no value\n", a_size(), unknown);
    if (left_out > 0)
      print_out("left out: {} cells of shapes that this program does not know; take a newer one\n", left_out);
  }

 private:
  [[nodiscard]] std::string a_size() const { return (size_ == "area" ? "an " : "a ") + size_; }

  std::string size_, rows_, places_, missing_;
};

void print_text(const Integrals& integrals, const std::string& name) {
  print_out("{}: a volume of {:.10g}\n\n", name, integrals.volume);
  IntegralTable table("volume");
  for (const Integral& of : integrals.attributes) table.add(of, of.volume, of.missing_volume);
  table.print(integrals.volume, integrals.unknown_volume, integrals.left_out);
}

void print_text(const SurfaceIntegrals& integrals, const std::string& name) {
  print_out("{}: an area of {:.10g}\n", name, integrals.area);
  if (!std::isnan(integrals.enclosed_volume))
    print_out("the contour is closed, round a volume of {:.10g}\n", integrals.enclosed_volume);
  if (!std::isnan(integrals.flux)) print_out("a flux of {:.10g}\n", integrals.flux);
  print_out("\n");
  IntegralTable table("area");
  for (const SurfaceIntegral& of : integrals.attributes) table.add(of, of.area, of.missing_area);
  table.print(integrals.area, integrals.unknown_area, integrals.left_out);
}

template <class Result>
void print(const Result& integrals, const std::string& name, bool as_json) {
  if (as_json)
    fmt::print("{}\n", json_text(to_json(integrals, name), 1));
  else
    print_text(integrals, name);
}

void add_surface_options(CommandLine& app, IntegralOptions& options, CommandOption* integrate) {
  auto* contour = app.add_option("--contour", options.contour,
                                 "Integrate over the surface on which the attribute NAME has this value instead: area, "
                                 "mean, and the volume inside if it is closed")
                      ->type_name("NAME=VALUE")
                      ->check(check_of(parse_contour))
                      ->needs(integrate);
  app.add_option("--slice", options.slice, "Integrate over the plane with this point and normal instead")
      ->type_name("X,Y,Z:NX,NY,NZ")
      ->check(check_of(parse_plane))
      ->needs(integrate)
      ->excludes(contour);
  app.add_option("--flux", options.flux,
                 "Print the flux of a vector, such as U of components U[0] to U[2]: along the normal of a slice, and "
                 "through a contour to where values are lower")
      ->type_name("NAME")
      ->needs(integrate);
}

}  // namespace

void add_integral_options(CommandLine& app, IntegralOptions& options) {
  auto* integrate = app.add_flag(
      "--integrate", options.integrate,
      "Print volume, integral, mean, and the least and the greatest value of each attribute of --attribute, over the "
      "cells of the mesh, from a file that keeps them. Cells are cut exactly by --box, --clip-plane and --range");
  app.add_option("--box", options.box, "Integrate in this box only")
      ->type_name("X0,Y0,Z0,X1,Y1,Z1")
      ->delimiter(',')
      ->expected(6)
      ->check(check_finite)
      ->needs(integrate);
  app.add_option("--clip-plane", options.clip_planes,
                 "Leave out what lies behind a plane: a point of it and its normal, which points to the side that "
                 "stays; repeatable")
      ->type_name("X,Y,Z:NX,NY,NZ")
      ->allow_extra_args(false)
      ->check(check_of(parse_plane))
      ->needs(integrate);
  app.add_option("--range", options.ranges,
                 "Integrate only where the attribute NAME has values from A to B; without A or B, there is no limit; "
                 "repeatable")
      ->type_name("NAME=A:B")
      ->allow_extra_args(false)
      ->check(check_of(parse_range))
      ->needs(integrate);
  add_surface_options(app, options, integrate);
  app.add_option("--memory", options.memory,
                 "Bytes of the file that integration may hold, such as 2G (default: a quarter of the machine's or "
                 "container's). More than 128 MiB are never held")
      ->type_name("SIZE")
      ->check(check_of(parse_bytes))
      ->needs(integrate);
}

void check_integral_options(const IntegralOptions& options) {
  for (std::size_t axis = 0; axis < 3 && !options.box.empty(); ++axis)
    if (!(options.box[axis] <= options.box[axis + 3])) wrong_option("--box", "the first corner must be the lower one");
  if (!options.flux.empty() && options.contour.empty() && options.slice.empty())
    wrong_option("--flux", "is through a surface: give --contour or --slice, too");
}

Status print_integrals(const format::Volume& volume, const IntegralOptions& options,
                       const std::vector<std::string>& attributes, bool as_json) {
  if (!options.contour.empty() || !options.slice.empty()) {
    SPLATVOL_TRY_ASSIGN(integrals, integrate_over_surface(volume, options, attributes));
    print(integrals, volume.name(), as_json);
    return {};
  }
  SPLATVOL_TRY_ASSIGN(integrals, integrate(volume, options, attributes));
  print(integrals, volume.name(), as_json);
  return {};
}

}  // namespace splatvol
