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

json to_json(const Integrals& integrals, const std::string& name) {
  const auto list_of = [](const dvec3& p) { return json{p.x, p.y, p.z}; };
  json attributes = json::array();
  for (const Integral& of : integrals.attributes)
    attributes.push_back({{"name", of.name},
                          {"unit", of.unit},
                          {"volume", of.volume},
                          {"missing_volume", of.missing_volume},
                          {"integral", of.integral},
                          {"mean", of.mean},
                          {"min", of.low},
                          {"min_at", list_of(of.low_position)},
                          {"max", of.high},
                          {"max_at", list_of(of.high_position)}});
  return {{"file", name},
          {"volume", integrals.volume},
          {"unknown_volume", integrals.unknown_volume},
          {"left_out", integrals.left_out},
          {"attributes", attributes}};
}

std::string text_of(const dvec3& p) { return fmt::format("({:.10g}, {:.10g}, {:.10g})", p.x, p.y, p.z); }

void print_text(const Integrals& integrals, const std::string& name) {
  print_out("{}: a volume of {:.10g}\n\n", name, integrals.volume);
  print_out("{:<24} {:>17} {:>17} {:>17} {:>17}  {}\n", "attribute", "integral", "mean", "min", "max", "unit");
  for (const Integral& of : integrals.attributes)
    print_out("{:<24} {:>17.10g} {:>17.10g} {:>17.10g} {:>17.10g}  {}\n", of.name, of.integral, of.mean, of.low,
              of.high, of.unit);
  print_out("\n");
  for (const Integral& of : integrals.attributes)
    if (of.volume > 0)
      print_out("{:<24} min at {}, max at {}\n", of.name, text_of(of.low_position), text_of(of.high_position));
  for (const Integral& of : integrals.attributes)
    if (of.missing_volume > 0)
      print_out("{:<24} has no value in a volume of {:.10g}, which is left out\n", of.name, of.missing_volume);
  if (!(integrals.volume > 0)) print_out("no part of a cell is in the region\n");
  if (integrals.unknown_volume > 0)
    print_out("left out: a volume of {:.10g} where an attribute of --range has no value\n", integrals.unknown_volume);
  if (integrals.left_out > 0)
    print_out("left out: {} cells of shapes that this program does not know; take a newer one\n", integrals.left_out);
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
}

Status print_integrals(const format::Volume& volume, const IntegralOptions& options,
                       const std::vector<std::string>& attributes, bool as_json) {
  SPLATVOL_TRY_ASSIGN(integrals, integrate(volume, options, attributes));
  if (as_json)
    fmt::print("{}\n", json_text(to_json(integrals, volume.name()), 1));
  else
    print_text(integrals, volume.name());
  return {};
}

}  // namespace splatvol
