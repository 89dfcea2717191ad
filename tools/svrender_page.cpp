#include "tools/svrender_page.h"

#include <charconv>
#include <cmath>
#include <memory>

#include "pictures/contrast.h"
#include "pictures/outline.h"
#include "player/scalar_bars.h"
#include "scene/srgb.h"
#include "streamer/first/default_scene.h"
#include "tools/scene_options.h"

namespace splatvol {
namespace {

constexpr std::array<int, 2> usual_size = {512, 512};

void set_bar(const RenderOptions& options, Scene& scene) {
  if (options.ticks) scene.scalar_bar.ticks = *options.ticks;
  if (options.unit) scene.scalar_bar.unit = *options.unit;
}

Result<Scene> make_scene(const RenderOptions& options, const format::Volume& volume, std::array<int, 2> size) {
  FirstPicture picture{size[0], size[1], dvec3(0), options.turntable > 0};
  if (!options.background.empty()) {
    SPLATVOL_TRY(store(parse_color(options.background), picture.background));
  }
  SPLATVOL_TRY_ASSIGN(scene, default_scene(volume, options.attribute, picture));
  if (!options.opacity_attribute.empty()) {
    SPLATVOL_TRY_ASSIGN(opacity, fitting_opacity(volume, options.opacity_attribute, picture));
    show_opacity(scene, std::move(opacity));
  }
  set_bar(options, scene);
  SPLATVOL_TRY(apply(options.planes, scene));
  return scene;
}

Result<Scene> read_scene(const RenderOptions& options) {
  SPLATVOL_TRY_ASSIGN(scene, load_scene(options.scene, options.size));
  set_bar(options, scene);
  if (options.background.empty()) return scene;
  SPLATVOL_TRY_ASSIGN(background, parse_color(options.background));
  adapt_to_background(scene, background);
  return scene;
}

Status add_bars(const format::Volume& volume, Composition& composition) {
  composition.text.ticks = composition.scene.scalar_bar.ticks;
  SPLATVOL_TRY_SET(composition.text.bars, scalar_bars_of(composition.scene, volume.info(), volume.name()));
  return {};
}

// Lays out the page, and gives the scene the size that is left.
Status lay_out(Composition& composition, std::array<int, 2> size) {
  PageText text = composition.text;
  if (composition.has_time) text.title = title_with_time(text.title, 0);
  SPLATVOL_TRY_ASSIGN(page, lay_out_page(size[0], size[1], text));
  composition.page = page;
  composition.scene.width = page.picture_width;
  composition.scene.height = page.picture_height;
  return {};
}

// The first scene's size decides about the page, and the page about the camera of the scene that is drawn.
Status fit_scene(const RenderOptions& options, const format::Volume& volume, Composition& composition) {
  std::array<int, 2> size = usual_size;
  if (!options.size.empty()) {
    SPLATVOL_TRY(store(parse_image_size(options.size), size));
  }
  SPLATVOL_TRY(store(make_scene(options, volume, size), composition.scene));
  if (options.scalar_bar) SPLATVOL_TRY(add_bars(volume, composition));
  SPLATVOL_TRY(lay_out(composition, size));
  if (composition.page.picture_width == size[0] && composition.page.picture_height == size[1]) return {};
  SPLATVOL_TRY(
      store(make_scene(options, volume, {composition.scene.width, composition.scene.height}), composition.scene));
  return {};
}

Status check_kind(const RenderOptions& options, const Composition& composition) {
  if (!composition.data) return {};
  if (options.scalar_bar || !options.title.empty() || options.has_time || options.transparent)
    return fail(ErrorCode::invalid_argument,
                "{}: an .exr holds light and alpha alone; --title, --time-label, --scalar-bar and --transparent need a "
                ".png",
                options.output);
  return {};
}

}  // namespace

Result<dvec3> parse_color(const std::string& text) {
  if (text == "white") return dvec3(1);
  if (text == "black") return dvec3(0);
  std::uint32_t code = 0;
  const char* end = text.data() + text.size();
  if (text.size() != 7 || text[0] != '#' || std::from_chars(text.data() + 1, end, code, 16).ptr != end)
    return fail(ErrorCode::invalid_argument, "'{}' is neither white nor black nor a colour such as #20c0ff", text);
  const auto channel = [&](int shift) { return linear_of_byte(static_cast<std::uint8_t>(code >> shift)); };
  return dvec3(channel(16), channel(8), channel(0));
}

Result<Composition> compose(const RenderOptions& options, const format::Steps& steps) {
  Composition composition;
  composition.data = options.output.ends_with(".exr") || options.output.ends_with(".EXR");
  composition.transparent = options.transparent;
  composition.text.title = options.title;
  composition.has_time = options.has_time;
  SPLATVOL_TRY(check_kind(options, composition));
  if (options.has_time && steps.times().empty())
    return fail(ErrorCode::invalid_argument, "--time-label: {} is no time series, so it has no times", steps.name());
  if (!options.scene.empty()) {
    SPLATVOL_TRY(store(read_scene(options), composition.scene));
  }
  const bool needs_volume = options.scene.empty() || options.planes.are_given() || options.scalar_bar ||
                            options.turntable > 0 || (composition.scene.outline && !composition.data);
  std::shared_ptr<const format::Volume> volume;
  if (needs_volume) {
    SPLATVOL_TRY_ASSIGN(step, find_step(steps, options.step));
    SPLATVOL_TRY(store(steps.volume(step), volume));
  }
  if (options.scene.empty()) {
    SPLATVOL_TRY(fit_scene(options, *volume, composition));
  } else {
    if (options.planes.are_given()) SPLATVOL_TRY(apply(options.planes, composition.scene));
    if (options.scalar_bar) SPLATVOL_TRY(add_bars(*volume, composition));
    SPLATVOL_TRY(lay_out(composition, {composition.scene.width, composition.scene.height}));
  }
  if (composition.scene.outline && !composition.data) {
    SPLATVOL_TRY(store(domain_of(*volume), composition.outline));
  }
  if (options.turntable > 0 && options.scene.empty()) {
    composition.turned_about = composition.scene.camera.focal_point;
  } else if (options.turntable > 0) {
    SPLATVOL_TRY(store(middle_of_visible(*volume, composition.scene), composition.turned_about));
  }
  return composition;
}

Status write_page(const Composition& composition, const View& view, std::optional<double> time, Image image,
                  const std::string& path, const Provenance& provenance) {
  const Scene& scene = composition.scene;
  if (path.ends_with(".exr") || path.ends_with(".EXR")) return write_image(path, image, scene.background, provenance);
  const dvec3 ink = ink_on(scene.background);
  const bool transparent = composition.transparent;
  if (composition.outline) draw_outline(image, view, *composition.outline, transparent ? ink_on_any() : ink);
  PageText text = composition.text;
  if (composition.has_time) text.title = title_with_time(text.title, time.value_or(0));
  SPLATVOL_TRY_ASSIGN(page, compose_page(composition.page, std::move(image), text, ink, transparent));
  return write_image(path, page, scene.background, provenance, composition.transparent);
}

}  // namespace splatvol
