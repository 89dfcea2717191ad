#include "splatvol/renderer.h"

#include <utility>

#include "library/renderer_core.h"
#include "library/worker.h"

namespace splatvol {

// All that draws lives on the worker's thread.
struct Renderer::Contents {
  std::unique_ptr<RendererCore> core;
  Worker worker;

  ~Contents() {
    worker.run([&] { core.reset(); });
  }

  template <class Draw>
  Result<Image> render(Draw draw) {
    return worker.run([&]() -> Result<Image> {
      SPLATVOL_TRY(draw(*core));
      return core->player().image();
    });
  }

  [[nodiscard]] const Player& player() const { return core->player(); }
};

Renderer::Renderer(std::unique_ptr<Contents> contents) : contents_(std::move(contents)) {}
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;
Renderer::~Renderer() = default;

Result<Renderer> Renderer::open(const std::string& path, const std::optional<Scene>& scene,
                                const RendererOptions& options) {
  auto contents = std::make_unique<Contents>();
  SPLATVOL_TRY(contents->worker.run([&]() -> Status {
    SPLATVOL_TRY_ASSIGN(core, RendererCore::open(path, scene, options, false));
    contents->core = std::move(core);
    return {};
  }));
  return Renderer(std::move(contents));
}

const Scene& Renderer::scene() const { return contents_->player().scene(); }
const std::vector<double>& Renderer::times() const { return contents_->player().steps().times(); }
std::size_t Renderer::step() const { return contents_->player().step(); }
const RenderStatistics& Renderer::statistics() const { return contents_->core->statistics(); }
std::string Renderer::device() const { return contents_->player().rasterizer().description(); }
void Renderer::cancel() { contents_->core->player().cancel(); }

Status Renderer::set_scene(const Scene& scene) {
  return contents_->worker.run([&] { return contents_->core->player().set_scene(scene); });
}

Result<Scene> Renderer::fitting_scene(const std::string& attribute, int width, int height) const {
  return contents_->worker.run([&] { return contents_->core->fitting_scene(attribute, width, height); });
}

Status Renderer::set_surface_depths(std::optional<SurfaceDepths> depths) {
  std::shared_ptr<const SurfaceDepths> shared;
  if (depths) shared = std::make_shared<SurfaceDepths>(std::move(*depths));
  return contents_->worker.run([&] { return contents_->core->player().set_surface_depths(shared); });
}

Status Renderer::show_step(std::size_t step) {
  return contents_->worker.run([&] { return contents_->core->player().show_step(step); });
}

Result<Image> Renderer::render(const Quality& quality) {
  return contents_->render([&](RendererCore& core) { return core.draw(quality); });
}

Result<Image> Renderer::render_within(double seconds) { return render({.milliseconds = 1e3 * seconds}); }

Result<Image> Renderer::render_now(double wait_seconds, const Quality& quality) {
  return contents_->render([&](RendererCore& core) { return core.draw_now(wait_seconds, quality); });
}

}  // namespace splatvol
