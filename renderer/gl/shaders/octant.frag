flat in vec4 color;
noperspective in vec2 offset;
layout(location = 0) out vec4 pixel;

void main() { pixel = color * exp2(-dot(offset, offset)); }
