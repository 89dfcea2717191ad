#include "splatvol/gl_renderer.h"

#include <utility>

#include "library/renderer_core.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/gl/host_picture.h"
#include "renderer/gl/host_state.h"

namespace splatvol {

struct GlRenderer::Contents {
  std::unique_ptr<RendererCore> core;
  std::optional<HostPicture> picture;

  // Each call that may reach OpenGL.
  template <class Call>
  auto run(Call call) {
    const HostState state;
    return call(core->player());
  }

  template <class Draw>
  Status draw(Draw draw) {
    return run([&](const Player& player) -> Status {
      SPLATVOL_TRY(draw(*core));
      return picture->show(player.picture());
    });
  }

  ~Contents() {
    const HostState state;
    picture.reset();
    core.reset();
  }
};

GlRenderer::GlRenderer(std::unique_ptr<Contents> contents) : contents_(std::move(contents)) {}
GlRenderer::GlRenderer(GlRenderer&&) noexcept = default;
GlRenderer& GlRenderer::operator=(GlRenderer&&) noexcept = default;
GlRenderer::~GlRenderer() = default;

Result<GlRenderer> GlRenderer::open(const std::string& path, const std::optional<Scene>& scene,
                                    const RendererOptions& options) {
  SPLATVOL_TRY(check_current_context());
  const HostState state;
  auto contents = std::make_unique<Contents>();
  SPLATVOL_TRY_ASSIGN(core, RendererCore::open(path, scene, options, true));
  SPLATVOL_TRY_ASSIGN(picture, HostPicture::create());
  contents->core = std::move(core);
  contents->picture.emplace(std::move(picture));
  return GlRenderer(std::move(contents));
}

const Scene& GlRenderer::scene() const { return contents_->core->player().scene(); }
const std::vector<double>& GlRenderer::times() const { return contents_->core->player().steps().times(); }
std::size_t GlRenderer::step() const { return contents_->core->player().step(); }
const RenderStatistics& GlRenderer::statistics() const { return contents_->core->statistics(); }
std::string GlRenderer::device() const { return contents_->core->player().rasterizer().description(); }
void GlRenderer::cancel() { contents_->core->player().cancel(); }
unsigned GlRenderer::texture() const { return contents_->picture->texture(); }

Status GlRenderer::set_scene(const Scene& scene) {
  return contents_->run([&](Player& player) { return player.set_scene(scene); });
}

Result<Scene> GlRenderer::fitting_scene(const std::string& attribute, int width, int height) const {
  return contents_->core->fitting_scene(attribute, width, height);
}

Status GlRenderer::show_step(std::size_t step) {
  return contents_->run([&](Player& player) { return player.show_step(step); });
}

Status GlRenderer::set_surface_depths(const std::optional<DepthTexture>& depths) {
  return contents_->run([&](Player& player) -> Status {
    if (!depths) return player.set_surface_depths(nullptr);
    const bool is_perspective = player.scene().camera.projection == Camera::Projection::perspective;
    SPLATVOL_TRY_ASSIGN(read, read_depths(*depths, is_perspective));
    return player.set_surface_depths(std::make_shared<SurfaceDepths>(std::move(read)));
  });
}

Status GlRenderer::draw(const Quality& quality) {
  return contents_->draw([&](RendererCore& core) { return core.draw(quality); });
}

Status GlRenderer::draw_within(double seconds) { return draw({.milliseconds = 1e3 * seconds}); }

Status GlRenderer::draw_now(double wait_seconds, const Quality& quality) {
  return contents_->draw([&](RendererCore& core) { return core.draw_now(wait_seconds, quality); });
}

Status GlRenderer::draw_over() const {
  return contents_->run([&](const Player&) { return contents_->picture->draw_over(); });
}

}  // namespace splatvol
