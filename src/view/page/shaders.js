// The programs of the graphics card.
//
// Blocks are drawn into two targets at once: what is needed to light a pixel (normal, kind of face) and the id of the
// thing there. Colours come in a second step from the ids, so that painting 200,000 cells is one small texture.

/** Kinds of a pixel, in the last byte of the first target. */
export const FACE = { none: 0, back: 128, cap: 192, front: 255 };

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp sampler2D;
// the entry of a thing: its colour, and its state: bit 0 shown, bit 1 chosen
uvec4 entry(usampler2D table, uint id, uint limit) {
  uint i = id < limit ? id : 0u;
  return texelFetch(table, ivec2(int(i & 4095u), int(i >> 12u)), 0);
}
`;

/** The width of the table of colours. */
export const TABLE_WIDTH = 4096;

export const BLOCK = {
  attributes: ["corner", "normal", "extra"],
  vertex: `${HEAD}
in uvec4 corner;   // place on the lattice from the block's origin, low bits of the slot
in vec2 normal;    // octahedral
in uvec2 extra;    // high bits of the slot, flags (bit 0: cap)
uniform mat4 matrix;
uniform mat3 turn;       // to right, up and back of the picture, of normals that are no unit vectors yet
uniform ivec3 base;      // the block's origin on the lattice, from the lattice point next to the eye
uniform int stride;      // lattice steps in a step of the block
uniform vec3 step;       // length of a step of the lattice
uniform vec3 rest;       // that lattice point from the eye
uniform vec4 plane;      // what is beyond it is cut off
uniform usampler2D slots;
uniform int wide;        // slots in a row of their texture
uniform int kind;        // 0 surfaces, 1 cells, 2 objects
uniform usampler2D table;
uniform uint limit;
flat out uint id;
flat out float cap;
out vec3 facing;
out float beyond;
void main() {
  int slot = int(corner.w | (extra.x << 16u));
  uvec4 ids = texelFetch(slots, ivec2(slot % wide, slot / wide), 0);
  id = kind == 0 ? ids.x : kind == 1 ? ids.y : ids.z;
  cap = float(extra.y & 1u);
  vec3 n = vec3(normal, 1.0 - abs(normal.x) - abs(normal.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  facing = turn * n;
  // the sum is one of integers, so that blocks that share a corner put it at the same place to the last bit
  vec3 place = vec3(base + ivec3(corner.xyz) * stride) * step + rest;
  beyond = dot(plane.xyz, place) - plane.w;
  bool shown = (entry(table, id, limit).a & 1u) == 1u;
  gl_Position = shown ? matrix * vec4(place, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
}`,
  fragment: `${HEAD}
flat in uint id;
flat in float cap;
in vec3 facing;
in float beyond;
uniform bool mirrored;
layout(location = 0) out vec4 face;
layout(location = 1) out uint thing;
void main() {
  if (beyond > 0.0) discard;
  vec3 n = normalize(facing);
  n.xy /= abs(n.x) + abs(n.y) + abs(n.z);
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  float what = gl_FrontFacing ? (cap > 0.5 ? 192.0 : 255.0) : 128.0;
  face = vec4(n.xy * 0.5 + 0.5, 0.0, what / 255.0);
  thing = id;
}`,
};

// One triangle over the whole picture.
const WHOLE = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;

export const LIGHT = {
  attributes: [],
  vertex: WHOLE,
  fragment: `${HEAD}
uniform sampler2D faces;
uniform usampler2D things;
uniform sampler2D depths;
uniform usampler2D table;
uniform uint limit;
uniform vec3 cut;        // colour of material that is cut
uniform vec3 top;        // background
uniform vec3 bottom;
uniform vec3 accent;     // around what is chosen
uniform bool solid;      // all is shown: the inside of a surface is material
uniform bool flatView;
uniform vec3 range;      // near, far, height of the picture at its middle
uniform bool any;        // something is chosen
uniform float dot_size;  // pixels of the screen in a pixel of the layout
out vec4 colour;
ivec2 size;
int kindAt(ivec2 p) { return int(texelFetch(faces, clamp(p, ivec2(0), size - 1), 0).a * 255.0 + 0.5); }
float away(ivec2 p) {
  float d = texelFetch(depths, clamp(p, ivec2(0), size - 1), 0).r;
  return flatView ? mix(range.x, range.y, d) : range.x * range.y / (range.y - d * (range.y - range.x));
}
bool chosen(ivec2 p) {
  p = clamp(p, ivec2(0), size - 1);
  int k = kindAt(p);
  if (k == 0 || (solid && k == 128)) return false;
  return (entry(table, texelFetch(things, p, 0).r, limit).a & 2u) != 0u;
}
void main() {
  size = textureSize(faces, 0);
  ivec2 p = ivec2(gl_FragCoord.xy);
  vec4 face = texelFetch(faces, p, 0);
  int kind = int(face.a * 255.0 + 0.5);
  vec3 shade;
  if (kind == 0) {
    shade = mix(bottom, top, gl_FragCoord.y / float(size.y));
  } else {
    vec3 n = vec3(face.xy * 2.0 - 1.0, 0.0);
    n.z = 1.0 - abs(n.x) - abs(n.y);
    if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
    n = normalize(n);
    if (n.z < 0.0) n = -n;
    float key = max(dot(n, normalize(vec3(-0.35, 0.55, 0.75))), 0.0);
    float light = 0.30 + 0.52 * key + 0.22 * n.z;
    vec3 base = vec3(entry(table, texelFetch(things, p, 0).r, limit).rgb) / 255.0;
    if (solid && kind == 128) shade = cut;
    else if (kind == 192) shade = cut * (0.55 + 0.45 * light);
    else {
      float gleam = pow(max(dot(n, normalize(vec3(-0.25, 0.4, 1.3))), 0.0), 40.0) * 0.10;
      shade = base * light + gleam;
    }
    // what lies behind something near is darker: depth is seen without shadows
    float here = away(p);
    float sum = 0.0;
    for (int i = 0; i < 8; i++) {
      float a = float(i) * 0.7853981634;
      ivec2 q = p + ivec2(round(vec2(cos(a), sin(a)) * (i % 2 == 0 ? 1.0 : 2.5) * dot_size));
      float there = away(q);
      sum += clamp((here - there) / (flatView ? range.z : here) * 24.0, 0.0, 1.0);
    }
    if (!(solid && kind == 128)) shade *= 1.0 - 0.5 * sum / 8.0;
  }
  // an outline around what is chosen, outside of it, and a breath of its colour inside
  bool own = any && chosen(p);
  if (own) shade = mix(shade, accent, 0.14);
  else if (any) {
    bool edge = false;
    for (int i = 0; i < 8; i++) {
      float a = float(i) * 0.7853981634;
      edge = edge || chosen(p + ivec2(round(vec2(cos(a), sin(a)) * 2.0 * dot_size)));
    }
    if (edge) shade = accent;
  }
  colour = vec4(shade, 1.0);
}`,
};

/** Steps on edges are blended along the edge. */
export const SMOOTH = {
  attributes: [],
  vertex: WHOLE,
  fragment: `${HEAD}
uniform sampler2D image;
out vec4 colour;
float bright(vec3 c) { return dot(c, vec3(0.299, 0.587, 0.114)); }
void main() {
  ivec2 size = textureSize(image, 0);
  vec2 unit = 1.0 / vec2(size);
  vec2 at = gl_FragCoord.xy * unit;
  vec3 mid = texture(image, at).rgb;
  float m = bright(mid);
  float a = bright(texture(image, at + unit * vec2(-1, -1)).rgb);
  float b = bright(texture(image, at + unit * vec2(1, -1)).rgb);
  float c = bright(texture(image, at + unit * vec2(-1, 1)).rgb);
  float d = bright(texture(image, at + unit * vec2(1, 1)).rgb);
  float low = min(m, min(min(a, b), min(c, d)));
  float high = max(m, max(max(a, b), max(c, d)));
  if (high - low < max(0.05, high * 0.125)) {
    colour = vec4(mid, 1.0);
    return;
  }
  vec2 way = vec2(-((a + b) - (c + d)), (a + c) - (b + d));
  float soft = max((a + b + c + d) * 0.03125, 0.0078125);
  way = clamp(way / (min(abs(way.x), abs(way.y)) + soft), -8.0, 8.0) * unit;
  vec3 near = 0.5 * (texture(image, at + way * (1.0 / 3.0 - 0.5)).rgb + texture(image, at + way * (2.0 / 3.0 - 0.5)).rgb);
  vec3 wide = near * 0.5 + 0.25 * (texture(image, at - way * 0.5).rgb + texture(image, at + way * 0.5).rgb);
  float w = bright(wide);
  colour = vec4(w < low || w > high ? near : wide, 1.0);
}`,
};

/** Lines over the picture, hidden by what is before them. */
export const LINES = {
  attributes: ["place", "tint"],
  vertex: `${HEAD}
in vec3 place;
in vec4 tint;
uniform mat4 matrix;
out vec4 shade;
void main() {
  shade = tint;
  gl_Position = matrix * vec4(place, 1.0);
}`,
  fragment: `${HEAD}
in vec4 shade;
uniform sampler2D depths;
out vec4 colour;
void main() {
  if (gl_FragCoord.z > texelFetch(depths, ivec2(gl_FragCoord.xy), 0).r + 1e-6) discard;
  colour = vec4(shade.rgb * shade.a, shade.a);
}`,
};

/** The volume's slice on the plane of the section. */
export const SLICE = {
  attributes: ["place", "share"],
  vertex: `${HEAD}
in vec3 place;
in vec2 share;
uniform mat4 matrix;
out vec2 at;
void main() {
  at = share;
  gl_Position = matrix * vec4(place, 1.0);
}`,
  fragment: `${HEAD}
in vec2 at;
uniform sampler2D image;
uniform sampler2D depths;
uniform sampler2D faces;
uniform bool whole;
uniform float level;     // the threshold, as a grey of the slice
out vec4 colour;
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  if (gl_FragCoord.z > texelFetch(depths, p, 0).r + 1e-6) discard;
  int kind = int(texelFetch(faces, p, 0).a * 255.0 + 0.5);
  vec3 grey = texture(image, at).rgb;
  // a line of sight that meets no surface behind the plane is in material all the way, or in air
  bool material = kind == 128 || (kind == 0 && grey.r >= level);
  if (!whole && !material) discard;
  colour = vec4(grey, 1.0);
}`,
};

/** Material at the faces of the volume, where no surface is seen. */
export const FILL = {
  attributes: ["place", "share"],
  vertex: `${HEAD}
in vec3 place;
in vec2 share;
uniform mat4 matrix;
uniform vec4 plane;
out vec2 at;
out float beyond;
void main() {
  at = share;
  beyond = dot(plane.xyz, place) - plane.w;
  gl_Position = matrix * vec4(place, 1.0);
}`,
  fragment: `${HEAD}
in vec2 at;
in float beyond;
uniform sampler2D mask;
uniform sampler2D faces;
uniform vec3 cut;
out vec4 colour;
void main() {
  bool free = texelFetch(faces, ivec2(gl_FragCoord.xy), 0).a == 0.0;
  if (!free || beyond > 0.0 || texture(mask, at).r < 0.5) discard;
  colour = vec4(cut, 1.0);
}`,
};

/** The depth of one pixel, as bits of a number. */
export const PROBE = {
  attributes: [],
  vertex: WHOLE,
  fragment: `${HEAD}
uniform sampler2D depths;
uniform ivec2 pixel;
out uint bits;
void main() { bits = floatBitsToUint(texelFetch(depths, pixel, 0).r); }`,
};
