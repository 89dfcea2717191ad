#include "tools/svgen_flow.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/file.h"
#include "base/json.h"
#include "builder/sources/vtk/writer.h"
#include "tools/bisection_mesh.h"
#include "tools/demo_flow.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

struct Demo {
  BisectionMesh mesh{DemoFlow::low, DemoFlow::high};
  DemoFlow flow;
  std::vector<FlowSample> samples;  // one for each point

  void sample_new_points() {
    for (std::size_t i = samples.size(); i < mesh.points().size(); ++i) samples.push_back(flow.at(mesh.points()[i]));
  }
};

/// Returns how urgently each tetrahedron needs refinement: the variation of vorticity and temperature within it, times
/// its size. So of cells with the same variation, the largest go first.
std::vector<float> indicators(const Demo& demo) {
  double strongest = 0;
  for (const FlowSample& sample : demo.samples) strongest = std::max(strongest, sample.vorticity);

  std::vector<float> result(demo.mesh.size());
  for (std::size_t i = 0; i < result.size(); ++i) {
    double low = std::numeric_limits<double>::max();
    double high = std::numeric_limits<double>::lowest();
    dvec3 lowest = DemoFlow::high;
    dvec3 highest = DemoFlow::low;
    for (const std::uint32_t vertex : demo.mesh.tetrahedron(i)) {
      const double value = demo.samples[vertex].vorticity / strongest + 0.5 * demo.samples[vertex].temperature;
      low = std::min(low, value);
      high = std::max(high, value);
      lowest = glm::min(lowest, demo.mesh.points()[vertex]);
      highest = glm::max(highest, demo.mesh.points()[vertex]);
    }
    result[i] = static_cast<float>((high - low) * glm::length(highest - lowest));
  }
  return result;
}

/// Marks the `count` tetrahedra with the largest indicators.
std::vector<char> mark_worst(const std::vector<float>& indicator, std::size_t count) {
  std::vector<std::uint32_t> order(indicator.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto worse = [&](std::uint32_t a, std::uint32_t b) {
    return std::pair(-indicator[a], a) < std::pair(-indicator[b], b);
  };
  count = std::min(count, order.size());
  std::ranges::nth_element(order, order.begin() + static_cast<std::ptrdiff_t>(count), worse);
  std::vector<char> marked(indicator.size(), 0);
  for (std::size_t i = 0; i < count; ++i) marked[order[i]] = 1;
  return marked;
}

Demo make_demo(std::size_t points) {
  Demo demo;
  // Cells no larger than an eighth of the box, or the knot would slip between the first samples.
  constexpr int uniform_rounds = 9;
  for (int i = 0; i < uniform_rounds; ++i) demo.mesh.refine(std::vector<char>(demo.mesh.size(), 1));
  demo.sample_new_points();

  ProgressBar progress("refining");
  while (demo.mesh.points().size() < points) {
    progress.update(static_cast<double>(demo.mesh.points().size()) / static_cast<double>(points));
    // About six tetrahedra share a new point. Near the end few are cut at a time, to end close to the wanted number.
    const std::size_t missing = points - demo.mesh.points().size();
    const std::size_t count = std::clamp<std::size_t>(2 * missing, 1, std::max<std::size_t>(1, demo.mesh.size() / 5));
    demo.mesh.refine(mark_worst(indicators(demo), count));
    demo.sample_new_points();
  }
  return demo;
}

}  // namespace

Status write_flow(const std::string& path, std::size_t points, Replace replace) {
  const Demo demo = make_demo(points);
  PointArray velocity{"velocity", 3, {}};
  PointArray vorticity{"vorticity", 1, {}};
  PointArray pressure{"pressure", 1, {}};
  PointArray temperature{"temperature", 1, {}};
  for (const FlowSample& sample : demo.samples) {
    for (int axis = 0; axis < 3; ++axis) velocity.values.push_back(static_cast<float>(sample.velocity[axis]));
    vorticity.values.push_back(static_cast<float>(sample.vorticity));
    pressure.values.push_back(static_cast<float>(sample.pressure));
    temperature.values.push_back(static_cast<float>(sample.temperature));
  }
  std::vector<std::array<std::uint32_t, 4>> tetrahedra;
  for (std::size_t i = 0; i < demo.mesh.size(); ++i) tetrahedra.push_back(demo.mesh.tetrahedron(i));
  const std::array arrays = {std::move(vorticity), std::move(velocity), std::move(pressure), std::move(temperature)};
  return write_vtu(path, demo.mesh.points(), tetrahedra, arrays, {.is_export = true, .replace = replace});
}

Status write_flow_scene(const std::string& path) {
  using nlohmann::ordered_json;
  const ordered_json scene = {
      {"camera",
       {{"projection", "perspective"},
        {"vertical_fov_degrees", 30.0},
        {"position", {2.1, -4.0, 4.9}},
        {"focal_point", {0.0, 0.0, -0.1}},
        {"up", {0.0, 0.0, 1.0}}}},
      {"image", {{"width", 768}, {"height", 768}}},
      {"background", {0.0, 0.0, 0.0}},
      {"attribute", "vorticity"},
      {"transfer_function",
       {{"domain", {0.0, 20.0}},
        {"colors", ordered_json::array({{0.0, 0.02, 0.05, 0.35},
                                        {0.15, 0.05, 0.30, 0.85},
                                        {0.4, 0.10, 0.75, 0.70},
                                        {0.65, 1.0, 0.45, 0.05},
                                        {1.0, 1.0, 0.10, 0.02}})},
        {"density", ordered_json::array({{0.0, 0.0}, {0.02, 0.05}, {0.1, 0.9}, {0.3, 2.5}, {0.6, 9.0}, {1.0, 24.0}})}}},
      {"lighting", false}};
  return write_text_file(path, json_text(scene, 1) + "\n");
}

}  // namespace splatvol
