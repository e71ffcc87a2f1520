// SPDX-License-Identifier: Apache-2.0
// The surface of a block with three.js: of its map one vertex per cell, coloured as the heat map, height times the
// exaggeration; of its scan the points, deviations times the exaggeration. It is drawn only when something changed, so an
// open view costs nothing.
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, Mesh, MeshLambertMaterial,
  PerspectiveCamera, Points, PointsMaterial, Scene, WebGLRenderer,
} from 'three';
import { exaggerated, sharesOf } from '../parts/cloud.js';
import { colourOf, heightColour } from '../parts/heat_scale.js';

const kStart = { azimuth: -0.6, elevation: 0.75, zoom: 1 };
const kElevationMax = 1.55;
const kFieldOfView_deg = 35;
const kShades = 256;
/// Colour of a point without a value.
const kGrey = [128, 128, 128];

const linear = (rgb) => new Color().setRGB(...rgb.map((part) => part / 255), 'srgb');

/// Vertices of seen cells and triangles between neighbours that were all seen.
function meshOf(map, end_mm) {
  const index = new Int32Array(map.columns * map.rows).fill(-1);
  const positions = [];
  const colours = [];
  for (let row = 0; row < map.rows; ++row) {
    for (let column = 0; column < map.columns; ++column) {
      const value = map.values[row * map.columns + column];
      if (value === null || value === undefined) continue;
      index[row * map.columns + column] = positions.length / 3;
      positions.push((column - map.columns / 2) * map.cell_mm, (row - map.rows / 2) * map.cell_mm, value);
      const colour = linear(heightColour(value, end_mm));
      colours.push(colour.r, colour.g, colour.b);
    }
  }
  const triangles = [];
  for (let row = 0; row + 1 < map.rows; ++row) {
    for (let column = 0; column + 1 < map.columns; ++column) {
      const [a, b, c, d] = [0, 1, map.columns, map.columns + 1].map((offset) => index[row * map.columns + column + offset]);
      if (a >= 0 && b >= 0 && c >= 0) triangles.push(a, b, c);
      if (b >= 0 && d >= 0 && c >= 0) triangles.push(b, d, c);
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(new Float32Array(positions), 3));
  geometry.setAttribute('color', new BufferAttribute(new Float32Array(colours), 3));
  geometry.setIndex(triangles);
  return geometry;
}

function pointsOf(cloud, low, high) {
  const shades = Array.from({ length: kShades }, (_, i) => linear(colourOf(i / (kShades - 1))));
  const grey = linear(kGrey);
  const colours = new Float32Array(3 * cloud.count);
  sharesOf(cloud.values, low, high).forEach((share, i) => {
    const colour = Number.isNaN(share) ? grey : shades[Math.round(share * (kShades - 1))];
    colours.set([colour.r, colour.g, colour.b], 3 * i);
  });
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(cloud.positions.slice(), 3));
  geometry.setAttribute('color', new BufferAttribute(colours, 3));
  return geometry;
}

/// Size of a point: more than the pitch of the points, so that a face looks closed. three.js draws points as large as with
/// a field of view of 90 deg.
function pointSize(cloud) {
  const pitch_mm = cloud.size_mm / Math.sqrt(cloud.count);
  return (1.6 * pitch_mm) / Math.tan((kFieldOfView_deg * Math.PI) / 360);
}

/// A view inside `host`; null if the browser has no WebGL. show(map, end_mm), show_cloud(cloud, low, high), clear(),
/// look(exaggeration, theme), key(name), dispose().
export function createSurface(host) {
  let renderer;
  try {
    renderer = new WebGLRenderer({ antialias: true, alpha: true });
  } catch {
    return null;
  }
  const scene = new Scene();
  const camera = new PerspectiveCamera(kFieldOfView_deg, 1, 1, 20000);
  camera.up.set(0, 0, 1);
  const sun = new DirectionalLight(0xffffff, 1.6);
  sun.position.set(-0.6, 0.5, 1);
  scene.add(new AmbientLight(0xffffff, 1.7), sun);
  const material = new MeshLambertMaterial({ vertexColors: true, side: DoubleSide });
  const point_material = new PointsMaterial({ vertexColors: true });
  let mesh = null;
  let cloud = null;  // that of `mesh`, if it is not a map
  let size_mm = 1;
  let asked = 0;
  let eye = { ...kStart };
  host.append(renderer.domElement);
  renderer.domElement.setAttribute('aria-hidden', 'true');

  function draw() {
    asked = 0;
    const distance = (1.9 * size_mm) / eye.zoom;
    camera.position.set(
      distance * Math.cos(eye.elevation) * Math.sin(eye.azimuth),
      -distance * Math.cos(eye.elevation) * Math.cos(eye.azimuth),
      distance * Math.sin(eye.elevation),
    );
    camera.lookAt(0, 0, 0);
    renderer.render(scene, camera);
  }
  const redraw = () => {
    if (asked === 0) asked = requestAnimationFrame(draw);
  };
  function fit() {
    const { clientWidth, clientHeight } = host;
    if (clientWidth === 0 || clientHeight === 0) return;
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    renderer.setSize(clientWidth, clientHeight);
    camera.aspect = clientWidth / clientHeight;
    camera.updateProjectionMatrix();
    redraw();
  }
  const watch = new ResizeObserver(fit);
  watch.observe(host);

  function turn(azimuth, elevation) {
    eye.azimuth += azimuth;
    eye.elevation = Math.min(kElevationMax, Math.max(-kElevationMax, eye.elevation + elevation));
    redraw();
  }
  function zoom(factor) {
    eye.zoom = Math.min(8, Math.max(0.5, eye.zoom * factor));
    redraw();
  }
  const canvas = renderer.domElement;
  const moved = (event) => {
    if (event.buttons !== 0) turn(-event.movementX * 0.008, event.movementY * 0.008);
  };
  const held = (event) => canvas.setPointerCapture(event.pointerId);
  const wheeled = (event) => {
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.1 : 1 / 1.1);
  };
  canvas.addEventListener('pointerdown', held);
  canvas.addEventListener('pointermove', moved);
  canvas.addEventListener('wheel', wheeled, { passive: false });

  function clear() {
    if (mesh === null) return;
    scene.remove(mesh);
    mesh.geometry.dispose();
    mesh = null;
    cloud = null;
  }

  return {
    show(map, end_mm) {
      clear();
      mesh = new Mesh(meshOf(map, end_mm), material);
      size_mm = Math.max(map.columns, map.rows) * map.cell_mm;
      scene.add(mesh);
      fit();
    },
    show_cloud(shown, low, high) {
      clear();
      cloud = shown;
      point_material.size = pointSize(cloud);
      mesh = new Points(pointsOf(cloud, low, high), point_material);
      // An exaggerated point may be anywhere, and a picture has only one cloud: always draw it.
      mesh.frustumCulled = false;
      size_mm = 1.15 * cloud.size_mm;  // the corner nearest to the eye is in the picture too
      scene.add(mesh);
      fit();
    },
    clear() {
      clear();
      redraw();
    },
    look(exaggeration, theme) {
      renderer.setClearColor(theme === 'light' ? 0xdfe3e6 : 0x14181b, 1);
      redraw();
      if (mesh === null) return;
      if (cloud !== null) {
        mesh.geometry.getAttribute('position').copyArray(exaggerated(cloud, exaggeration)).needsUpdate = true;
        return;
      }
      mesh.scale.z = exaggeration;
      // Normals follow the drawn heights; otherwise an exaggerated surface would be lit as if it were flat.
      mesh.geometry.deleteAttribute('normal');
      const scaled = mesh.geometry.clone();
      scaled.scale(1, 1, exaggeration);
      scaled.computeVertexNormals();
      const normals = scaled.getAttribute('normal').array;
      for (let i = 2; i < normals.length; i += 3) {
        // The renderer divides normals by the scale of the mesh.
        normals[i] *= exaggeration;
      }
      mesh.geometry.setAttribute('normal', new BufferAttribute(normals, 3));
      scaled.dispose();
    },
    key(name) {
      const step = 0.1;
      const keys = {
        ArrowLeft: () => turn(-step, 0), ArrowRight: () => turn(step, 0), ArrowUp: () => turn(0, step),
        ArrowDown: () => turn(0, -step), '+': () => zoom(1.15), '=': () => zoom(1.15), '-': () => zoom(1 / 1.15),
        Home: () => { eye = { ...kStart }; redraw(); },
      };
      if (!(name in keys)) return false;
      keys[name]();
      return true;
    },
    dispose() {
      cancelAnimationFrame(asked);
      watch.disconnect();
      canvas.removeEventListener('pointerdown', held);
      canvas.removeEventListener('pointermove', moved);
      canvas.removeEventListener('wheel', wheeled);
      mesh?.geometry.dispose();
      material.dispose();
      point_material.dispose();
      renderer.dispose();
      canvas.remove();
    },
  };
}
