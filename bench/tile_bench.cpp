// Draws frames of a file by OpenGL and by tiles in turn. Prints times, and the difference of the pictures.
// tile_bench FILE.svol SCENE.json [REPEATS [SAMPLE_SPACING [none|axis|exact [OUTPUT]]]]
// tile_bench --random COUNT PIXELS [REPEATS]: random splats so many pixels wide, drawn by tiles alone
// tile_bench --fit FILE.svol SCENE.json [FILE.svol SCENE.json...]: the constants of renderer/work.h

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <random>
#include <string_view>

#include "bench/work_fit.h"
#include "renderer/cpu/tile_rasterizer.h"
#include "renderer/gl/context.h"
#include "renderer/gl/gl_rasterizer.h"
#include "streamer/splats/streamer.h"

namespace splatvol {
namespace {

double median(std::vector<double> numbers) {
  std::ranges::sort(numbers);
  return numbers[numbers.size() / 2];
}

double seconds(const FrameTimes& times) { return times.sort + times.upload + times.draw; }

void print(const char* name, const std::vector<FrameTimes>& frames) {
  const auto part = [&](auto member) {
    std::vector<double> numbers;
    for (const FrameTimes& times : frames) numbers.push_back(times.*member);
    return 1e3 * median(numbers);
  };
  std::vector<double> all;
  for (const FrameTimes& times : frames) all.push_back(seconds(times));
  fmt::print("  {:4} {:8.1f} ms (sort {:.1f}, upload {:.1f}, draw {:.1f}; least {:.1f})\n", name, 1e3 * median(all),
             part(&FrameTimes::sort), part(&FrameTimes::upload), part(&FrameTimes::draw), 1e3 * std::ranges::min(all));
}

/// Random balls in [-1, 1]^3 as seen by `view`, in rows of 4096.
DrawList random_list(std::size_t count, double deviation) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  DrawList list;
  std::vector<MomentsSplat> splats;
  while (count > 0) {
    splats.resize(std::min<std::size_t>(count, 4096));
    count -= splats.size();
    const dvec3 corner = 0.9 * dvec3(unit(generator), unit(generator), unit(generator));
    for (MomentsSplat& splat : splats) {
      splat.center = 0.1 * dvec3(unit(generator), unit(generator), unit(generator));
      splat.deviations = dvec3(deviation);
      splat.mass = 0.02 * deviation * deviation;
      splat.value = 0.5 + 0.5 * unit(generator);
      splat.value_deviation = 0.05;
      splat.correlations = dvec3(0.5, 0.3, 0.2);
    }
    append(list, pack_row(splats, corner, 1), 0, static_cast<std::uint32_t>(splats.size()));
  }
  return list;
}

int run_random(int argc, char** argv) {
  Camera camera;
  camera.position = {0, 0, 6};
  View view = make_view(camera, 512, 512).value();
  const double pixel = 6 / view.focal, half_axes = 2 * 3.29;
  const DrawList list = random_list(std::strtoull(argv[2], nullptr, 10), std::atof(argv[3]) * pixel / half_axes);
  TransferFunction function;
  function.colors = {{0, {1, 0, 0}}, {1, {0, 0, 1}}};
  function.densities = {{0, 0.5}, {1, 5}};
  TileRasterizer cpu(KernelKind::moments);
  if (!cpu.set_transfer_function(function, {}) || !cpu.set_draw_list(list)) return 1;
  std::vector<FrameTimes> frames;
  const std::clock_t begin = std::clock();
  const int repeats = argc > 4 ? std::atoi(argv[4]) : 5;
  for (int i = 0; i < repeats; ++i) {
    view.eye.x += 1e-3;  // so that the order is made anew
    frames.push_back(cpu.draw(view, SortMode::exact, 1).value());
  }
  fmt::print("{} splats, {} pixels wide, {}: {:.1f} ms of processor time, {:.1f} MiB\n", list.splats, argv[3],
             cpu.description(), 1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC / repeats,
             static_cast<double>(cpu.device_bytes()) / 1048576);
  print("cpu", frames);
  return 0;
}

int run(int argc, char** argv) {
  const Scene scene = load_scene(argv[2]).value();
  const int repeats = argc > 3 ? std::atoi(argv[3]) : 9;
  const int spacing = argc > 4 ? std::atoi(argv[4]) : 1;
  const std::string mode = argc > 5 ? argv[5] : "exact";
  const SortMode sort = mode == "none" ? SortMode::none : mode == "axis" ? SortMode::axis : SortMode::exact;
  View view = make_view(scene).value();
  const auto streamer = Streamer::open(open_file(argv[1]).value(), {.memory_bytes = std::uint64_t{8} << 30,
                                                                    .attribute = scene.attribute,
                                                                    .kernel = KernelKind::moments})
                            .value();
  const FrameSplats& frame = *streamer->request(view, scene.transfer_function, {.tolerance_percent = 0}).value();
  const DrawList& list = frame.list;

  const auto context = HeadlessContext::create().value();
  const auto gl = GlRasterizer::create(KernelKind::moments).value();
  TileRasterizer cpu(KernelKind::moments);
  gl->set_lighting(scene.lighting);
  cpu.set_lighting(scene.lighting);
  if (!gl->set_transfer_function(scene.transfer_function, streamer->units()) || !gl->set_draw_list(list) ||
      !cpu.set_transfer_function(scene.transfer_function, streamer->units()) || !cpu.set_draw_list(list))
    return 1;

  std::vector<FrameTimes> by_gl, by_cpu;
  std::vector<double> processor_seconds;  // of all threads
  View other = view;
  other.width += 1;  // so that the order is made anew
  for (int i = 0; i < repeats; ++i) {
    static_cast<void>(gl->draw(other, sort, spacing).value());
    static_cast<void>(cpu.draw(other, sort, spacing).value());
    by_gl.push_back(gl->draw(view, sort, spacing).value());
    const std::clock_t begin = std::clock();
    by_cpu.push_back(cpu.draw(view, sort, spacing).value());
    processor_seconds.push_back(static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  const Image a = gl->read_image().value(), b = cpu.read_image().value();
  const ImageDifference difference = compare_images(a, b).value();
  fmt::print("{}: {} splats, {}\n", argv[2], list.splats, cpu.description());
  print("gl", by_gl);
  print("cpu", by_cpu);
  std::vector<double> ratios;
  for (int i = 0; i < repeats; ++i) ratios.push_back(seconds(by_gl[i]) / seconds(by_cpu[i]));
  fmt::print(
      "  gl / cpu {:.2f}; {:.1f} ms of processor time; rmse {:.2e}, largest {:.2e}, means {:.5f} {:.5f}; {:.1f} MiB\n",
      median(ratios), 1e3 * median(processor_seconds), difference.rmse, difference.max, difference.mean_a,
      difference.mean_b, static_cast<double>(cpu.device_bytes()) / 1048576);
  if (argc > 6) {
    static_cast<void>(write_image(std::string(argv[6]) + "_gl.png", a, scene.background, {}));
    static_cast<void>(write_image(std::string(argv[6]) + "_cpu.png", b, scene.background, {}));
  }
  return 0;
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  if (argc > 3 && std::string_view(argv[1]) == "--fit") {
    const auto fitted = splatvol::fit_work(std::span(argv, static_cast<std::size_t>(argc)).subspan(2));
    if (!fitted) fmt::print(stderr, "{}\n", fitted.error().message);
    return fitted ? 0 : 1;
  }
  if (argc > 3 && std::string_view(argv[1]) == "--random") return splatvol::run_random(argc, argv);
  return argc < 3 ? 2 : splatvol::run(argc, argv);
}
