// OpenGL objects that delete themselves, and errors as Status. Internal to the renderer.
#pragma once

#include <epoxy/gl.h>

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

#include "base/error.h"

namespace splatvol {

/// Owns one OpenGL name. The context that made it must be current when it is destroyed.
template <void (*Delete)(GLuint)>
class GlObject {
 public:
  GlObject() = default;
  explicit GlObject(GLuint name) : name_(name) {}
  GlObject(GlObject&& other) noexcept : name_(std::exchange(other.name_, 0)) {}
  GlObject& operator=(GlObject&& other) noexcept {
    std::swap(name_, other.name_);
    return *this;
  }
  ~GlObject() {
    if (name_ != 0) Delete(name_);
  }

  [[nodiscard]] GLuint name() const { return name_; }

 private:
  GLuint name_ = 0;
};

inline void delete_texture(GLuint name) { glDeleteTextures(1, &name); }
inline void delete_framebuffer(GLuint name) { glDeleteFramebuffers(1, &name); }
inline void delete_vertex_array(GLuint name) { glDeleteVertexArrays(1, &name); }
inline void delete_program(GLuint name) { glDeleteProgram(name); }
inline void delete_buffer(GLuint name) { glDeleteBuffers(1, &name); }

using Texture = GlObject<delete_texture>;
using Framebuffer = GlObject<delete_framebuffer>;
using VertexArray = GlObject<delete_vertex_array>;
using Program = GlObject<delete_program>;

/// Returns the device and version of the current context: "GL_RENDERER, OpenGL GL_VERSION".
[[nodiscard]] std::string device_text();

/// Fails with ErrorCode::device unless the current context has OpenGL 4.5.
[[nodiscard]] Status check_current_context();

/// Returns the most bytes of one buffer that the device's shaders can see.
[[nodiscard]] std::uint64_t largest_buffer();

/// A buffer that grows on demand, and forgets its contents when it grows.
class Buffer {
 public:
  /// `name` appears in messages: a literal.
  explicit Buffer(std::string_view name) : name_(name) {}

  /// Makes room for at least `bytes`; exactly as many if the buffer must grow. Fails with ErrorCode::device if a shader
  /// could not see that many bytes of one buffer, or the device has no memory left.
  [[nodiscard]] Status reserve(std::size_t bytes);

  /// Replaces the first `bytes` bytes. Requires reserve(bytes) before.
  void write(const void* data, std::size_t bytes) { write_at(0, data, bytes); }

  /// Replaces `bytes` bytes from an offset on. Requires reserve(offset + bytes) before.
  void write_at(std::size_t offset, const void* data, std::size_t bytes);

  /// Lets the CPU read the first `bytes` > 0 bytes until unmap. Null if the device refuses.
  [[nodiscard]] const void* map_to_read(std::size_t bytes);
  void unmap();

  void bind(GLenum target, GLuint binding) const { glBindBufferBase(target, binding, object_.name()); }
  [[nodiscard]] std::string_view name() const { return name_; }
  [[nodiscard]] GLuint object() const { return object_.name(); }
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  std::string_view name_;
  GlObject<delete_buffer> object_;
  std::size_t bytes_ = 0;
};

/// One stage of a program: its kind, and its source in parts that follow each other.
struct ShaderStage {
  GLenum kind;
  std::initializer_list<std::string_view> sources;
};

/// Compiles and links. An error carries the first line of the driver's log and `name`.
[[nodiscard]] Result<Program> build_program(std::string_view name, std::initializer_list<ShaderStage> stages);

/// Fails with ErrorCode::device if OpenGL has recorded an error since the last call. `action` names the work at hand.
[[nodiscard]] Status check_gl(std::string_view action);

}  // namespace splatvol
