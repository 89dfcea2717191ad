#include "renderer/gl/context.h"

// Epoxy's headers go before any other of OpenGL or EGL.
#include <epoxy/gl.h>
#include <fmt/format.h>

#include <epoxy/egl.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/memory_limit.h"
#include "renderer/gl/gl_objects.h"

namespace splatvol {

namespace {

struct Candidate {
  std::string name;
  EGLDisplay display;
};

/// Returns the name of EGL's last error.
std::string egl_error() {
  constexpr std::array<std::pair<EGLint, const char*>, 7> names = {{{EGL_SUCCESS, "no reason given"},
                                                                    {EGL_NOT_INITIALIZED, "EGL_NOT_INITIALIZED"},
                                                                    {EGL_BAD_ALLOC, "EGL_BAD_ALLOC"},
                                                                    {EGL_BAD_MATCH, "EGL_BAD_MATCH"},
                                                                    {EGL_BAD_ATTRIBUTE, "EGL_BAD_ATTRIBUTE"},
                                                                    {EGL_BAD_CONFIG, "EGL_BAD_CONFIG"},
                                                                    {EGL_BAD_PARAMETER, "EGL_BAD_PARAMETER"}}};
  const EGLint code = eglGetError();
  const auto found = std::ranges::find(names, code, &std::pair<EGLint, const char*>::first);
  return found == names.end() ? fmt::format("EGL error 0x{:x}", code) : found->second;
}

/// Adds the displays of the devices that are hardware. Mesa lists its software rasteriser as one more device.
void add_hardware(std::vector<Candidate>& candidates) {
  if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_device") ||
      !epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_device_enumeration") ||
      !epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_device_query"))
    return;

  std::array<EGLDeviceEXT, 16> devices{};
  EGLint count = 0;
  if (!eglQueryDevicesEXT(static_cast<EGLint>(devices.size()), devices.data(), &count)) return;
  for (EGLint i = 0; i < count; ++i) {
    const char* extensions = eglQueryDeviceStringEXT(devices[i], EGL_EXTENSIONS);
    if (extensions && epoxy_extension_in_string(extensions, "EGL_MESA_device_software")) continue;
    candidates.push_back(
        {fmt::format("EGL device {}", i), eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, devices[i], nullptr)});
  }
}

/// Returns the displays to try, best first: a graphics card comes before Mesa's software.
std::vector<Candidate> candidate_displays(ContextKind kind) {
  std::vector<Candidate> candidates;
  add_hardware(candidates);
  if (kind == ContextKind::hardware) return candidates;

  // The EXT entry point: through epoxy, the core one aborts if the client library is EGL 1.4.
  if (epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless"))
    candidates.push_back({"Mesa's surfaceless platform",
                          eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr)});
  candidates.push_back({"default display", eglGetDisplay(EGL_DEFAULT_DISPLAY)});
  return candidates;
}

/// Makes a current OpenGL 4.5 core context on an initialised display, or returns EGL's reason why there is none.
tl::expected<EGLContext, std::string> make_context(EGLDisplay display) {
  if (!epoxy_has_egl_extension(display, "EGL_KHR_surfaceless_context"))
    return tl::unexpected<std::string>("no EGL_KHR_surfaceless_context");
  if (!eglBindAPI(EGL_OPENGL_API)) return tl::unexpected(egl_error());

  // Surface type 0: a config that needs no surface. The default asks for windows.
  constexpr std::array<EGLint, 5> config_attributes{EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE, 0, EGL_NONE};
  EGLConfig config = nullptr;
  EGLint config_count = 0;
  if (!eglChooseConfig(display, config_attributes.data(), &config, 1, &config_count) || config_count == 0)
    return tl::unexpected<std::string>("no config for OpenGL");

  constexpr std::array<EGLint, 7> context_attributes{
      EGL_CONTEXT_MAJOR_VERSION,           4,       EGL_CONTEXT_MINOR_VERSION, 5, EGL_CONTEXT_OPENGL_PROFILE_MASK,
      EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
  const EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, context_attributes.data());
  if (context == EGL_NO_CONTEXT) return tl::unexpected("no OpenGL 4.5 core context: " + egl_error());

  if (!eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
    const std::string reason = egl_error();
    eglDestroyContext(display, context);
    return tl::unexpected("cannot make the context current: " + reason);
  }
  return context;
}

}  // namespace

bool is_software_renderer(std::string_view description) {
  std::string lower(description);
  std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  constexpr std::array<std::string_view, 6> names{"llvmpipe", "softpipe", "swrast", "swr ", "software", "swiftshader"};
  return std::ranges::any_of(names, [&](std::string_view name) { return lower.find(name) != std::string::npos; });
}

Status check_space_for_drivers() {
  constexpr std::uint64_t gibibyte = std::uint64_t{1} << 30;
  if (is_addressable(gibibyte / 2 * 3)) return {};  // Mesa and LLVM take 1 GiB with a small picture
  return fail(ErrorCode::device, "OpenGL's drivers need 1.5 GiB of address space: raise the limit (ulimit -v)");
}

Result<std::unique_ptr<HeadlessContext>> HeadlessContext::create(ContextKind kind) {
  SPLATVOL_TRY(check_space_for_drivers());
  std::string reasons = kind == ContextKind::hardware ? "no graphics card" : "";
  for (const Candidate& candidate : candidate_displays(kind)) {
    if (!reasons.empty()) reasons += "; ";
    if (candidate.display == EGL_NO_DISPLAY || !eglInitialize(candidate.display, nullptr, nullptr)) {
      reasons += candidate.name + ": " + egl_error();
      continue;
    }
    if (auto context = make_context(candidate.display)) {
      std::unique_ptr<HeadlessContext> made(new HeadlessContext(candidate.display, *context));
      if (kind == ContextKind::any || !is_software_renderer(made->description())) return made;
      reasons += candidate.name + ": draws in software";
    } else {
      reasons += candidate.name + ": " + context.error();
    }
  }
  return fail(ErrorCode::device, "no OpenGL 4.5 without a window here ({})", reasons);
}

HeadlessContext::HeadlessContext(void* display, void* context)
    : display_(display), context_(context), description_(device_text()) {}

HeadlessContext::~HeadlessContext() {
  // The display stays open: EGL shares it with the other contexts of the process.
  if (eglGetCurrentContext() == context_) eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(display_, context_);
}

}  // namespace splatvol
