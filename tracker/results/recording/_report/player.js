"use strict";
// The report's player: bodies and cameras in space beside the video of all views. Needs no network.
(async function () {
  const root = document.getElementById("player");
  const fail = (words) => {
    root.dataset.state = "failed";
    document.getElementById("player-stage").textContent = words + " The pictures below show the same frames.";
  };
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const unzipped = async (text) =>
    new Response(new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  if (typeof DecompressionStream === "undefined") return fail("This browser is too old for the player.");

  (0, eval)(new TextDecoder().decode(await unzipped(document.getElementById("player-three").textContent.trim())) + ";window.THREE=THREE");
  const scene_data = JSON.parse(document.getElementById("player-scene").textContent);
  const stage = document.getElementById("player-stage");
  const video = document.getElementById("player-video");
  const slider = document.getElementById("player-slider");
  const label = document.getElementById("player-label");
  const toggle = document.getElementById("player-toggle");
  const speed = document.getElementById("player-speed");
  const from = document.getElementById("player-from");
  const times = scene_data.times, n_frames = times.length;

  // Scene

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  } catch (error) {
    return fail("This browser has no WebGL.");
  }
  stage.replaceChildren(renderer.domElement);
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xf3f5f7);
  const eye = new THREE.PerspectiveCamera(45, 1, 0.05, 200);
  eye.up.set(0, 0, 1);
  const light = new THREE.DirectionalLight(0xffffff, 1.8);
  scene.add(new THREE.AmbientLight(0xffffff, 1.4), light, eye);

  const COLOURS = [0x6d9ab5, 0xe67e22, 0xc0392b];
  const people = [];
  for (const [k, told] of scene_data.persons.entries()) {
    const [points, normals, faces, placed] = await Promise.all(
      [told.points, told.normals, told.faces, told.placed].map(unzipped));
    const [parts, known] = (await Promise.all([told.parts_of_points, told.known].map(unzipped))).map((b) => new Uint8Array(b));
    const n_segments = told.segments.length, segments = told.segments_of_parts;
    const person = { placed: new Float32Array(placed), n_segments, segments, known, meshes: [] };
    const position = new THREE.BufferAttribute(new Float32Array(points), 3);
    const normal = new THREE.BufferAttribute(new Float32Array(normals), 3);
    const corners = new Uint32Array(faces);
    for (let p = 0; p < told.parts.length; p++) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", position);
      geometry.setAttribute("normal", normal);
      const own = [];
      for (let f = 0; f < corners.length; f += 3)
        if (parts[corners[f]] === p) own.push(corners[f], corners[f + 1], corners[f + 2]);
      geometry.setIndex(own);
      const material = new THREE.MeshLambertMaterial({ color: COLOURS[0] });
      const mesh = new THREE.Mesh(geometry, material);
      mesh.frustumCulled = false;
      mesh.userData.colour = new THREE.Color(COLOURS[0]).offsetHSL(0.13 * k, 0, 0);
      person.meshes.push(mesh);
      scene.add(mesh);
    }
    people.push(person);
  }

  // Where everybody walks: the middle of the first segments, and the floor under them

  const low = new THREE.Vector3(Infinity, Infinity, Infinity), high = low.clone().negate(), point = new THREE.Vector3();
  for (const person of people)
    for (let i = 0; i < person.placed.length; i += 7) {
      point.fromArray(person.placed, i);
      low.min(point);
      high.max(point);
    }
  const middle = low.clone().add(high).multiplyScalar(0.5), reach = Math.max(high.distanceTo(low), 1);
  const floor = new THREE.GridHelper(2 * Math.ceil(reach + 1), 4 * Math.ceil(reach + 1), 0x9aa7b3, 0xd3dae0);
  floor.rotation.x = Math.PI / 2;
  floor.position.set(Math.round(middle.x), Math.round(middle.y), low.z - 0.1);
  scene.add(floor);
  light.position.set(middle.x + 2, middle.y - 3, high.z + 4);

  // Cameras: a pyramid each, with the view on its base

  const has_video = video.dataset.video !== "";
  if (has_video) {
    const encoded = document.getElementById("player-mp4").textContent.trim();
    video.addEventListener("seeked", () => (root.dataset.video = "shown"));
    video.addEventListener("error", () => (root.dataset.video = "failed: " + video.error.message));
    video.src = URL.createObjectURL(new Blob([bytes(encoded)], { type: "video/mp4" }));
  } else video.hidden = true;
  const texture = has_video ? new THREE.VideoTexture(video) : null;
  if (texture) texture.colorSpace = THREE.SRGBColorSpace;
  const pictures = new THREE.Group();
  scene.add(pictures);
  const places = scene_data.cameras.map((told) => {
    const rows = told.world_from_camera, depth = 0.16 * reach;
    const at = (x, y, z) => new THREE.Vector3(...[0, 1, 2].map((r) => rows[r][0] * x + rows[r][1] * y + rows[r][2] * z + rows[r][3]));
    const n = told.sheet.length, last = n - 1, sheet = told.sheet.flat().map(([x, y]) => at(x * depth, y * depth, depth));
    const apex = at(0, 0, 0), edges = [0, last, n * n - 1, n * last].flatMap((corner) => [apex, sheet[corner]]);
    for (let i = 0; i < last; i++)
      for (const [start, step] of [[0, 1], [n * last, 1], [0, n], [last, n]])
        edges.push(sheet[start + step * i], sheet[start + step * (i + 1)]);
    const frame = new THREE.BufferGeometry().setFromPoints(edges);
    scene.add(new THREE.LineSegments(frame, new THREE.LineBasicMaterial({ color: 0x5c6b7a })));
    if (texture) {
      const [u0, v0, u1, v1] = told.window;
      const face = new THREE.BufferGeometry().setFromPoints(sheet);
      const shares = sheet.flatMap((_, i) => [u0 + ((u1 - u0) * (i % n)) / last, 1 - v0 - ((v1 - v0) * Math.floor(i / n)) / last]);
      face.setAttribute("uv", new THREE.BufferAttribute(new Float32Array(shares), 2));
      const squares = sheet.map((_, i) => i).filter((i) => i % n < last && i < n * last);
      face.setIndex(squares.flatMap((i) => [i, i + 1, i + n + 1, i, i + n + 1, i + n]));
      pictures.add(new THREE.Mesh(face, new THREE.MeshBasicMaterial({ map: texture, side: THREE.DoubleSide })));
    }
    return { apex, ahead: at(0, 0, Math.max(apex.distanceTo(middle), 1)), sheet: told.sheet };
  });

  const controls = new THREE.OrbitControls(eye, renderer.domElement);
  function look(which) {
    const place = places[which];
    eye.fov = place ? (2 * Math.atan(Math.max(...place.sheet.map((row) => Math.abs(row[row.length >> 1][1])))) * 180) / Math.PI : 45;
    if (place) eye.position.copy(place.apex);
    else eye.position.set(middle.x + 1.1 * reach, middle.y - 1.6 * reach, middle.z + 0.6 * reach);
    controls.target.copy(place ? place.ahead : middle);
    pictures.children.forEach(({ material }, v) => {
      material.transparent = v === which; // the body shines through the picture that lies before it
      material.opacity = v === which ? 0.5 : 1;
      material.depthWrite = v !== which;
      material.needsUpdate = true;
    });
    eye.updateProjectionMatrix();
    controls.update();
  }
  from.append(new Option("from outside", -1), ...scene_data.cameras.map((c, v) => new Option("from " + c.name, v)));
  from.onchange = () => look(Number(from.value));
  document.getElementById("player-images").onchange = (event) => (pictures.visible = event.target.checked);
  look(-1);

  // Time

  let frame = -1, playing = false, since = 0, began = 0;
  function show(k) {
    k = Math.max(0, Math.min(n_frames - 1, k));
    if (k === frame) return;
    frame = k;
    for (const person of people)
      person.meshes.forEach((mesh, p) => {
        const i = 7 * (k * person.n_segments + person.segments[p]), state = person.known[k * person.meshes.length + p];
        mesh.position.fromArray(person.placed, i);
        mesh.quaternion.fromArray(person.placed, i + 3);
        mesh.material.color.copy(state ? new THREE.Color(COLOURS[state]) : mesh.userData.colour);
        mesh.material.transparent = state === 2;
        mesh.material.opacity = state === 2 ? 0.25 : 1;
      });
    slider.value = k;
    label.textContent = times[k].toFixed(2) + " s (frame " + scene_data.frames[k] + ")";
    document.getElementById("player-why").textContent = scene_data.why[k];
    root.dataset.frame = scene_data.frames[k];
    for (const needle of document.querySelectorAll(".needle"))
      needle.style.left = (100 * (times[k] - needle.parentElement.dataset.begin)) / (needle.parentElement.dataset.end - needle.parentElement.dataset.begin) + "%";
  }
  const seek = (k) => {
    show(k);
    if (has_video) video.currentTime = (frame + 0.5) / scene_data.fps;
    began = frame;
    since = performance.now();
  };
  const rate = () => Number(speed.value) / (scene_data.interval * scene_data.fps);
  function play(on) {
    playing = on;
    toggle.textContent = on ? "pause" : "play";
    if (on && frame >= n_frames - 1) seek(0);
    else seek(frame);
    if (!has_video) return;
    video.playbackRate = Math.max(0.07, Math.min(16, rate()));
    if (on) video.play();
    else video.pause();
  }
  const nearest = (time) => times.reduce((best, t, k) => (Math.abs(t - time) < Math.abs(times[best] - time) ? k : best), 0);
  toggle.onclick = () => play(!playing);
  speed.onchange = () => play(playing);
  slider.max = n_frames - 1;
  slider.oninput = () => { if (playing) play(false); seek(Number(slider.value)); };
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("input, select, button")) return;
    if (event.key === " ") toggle.click();
    else if (event.key === "ArrowRight") seek(frame + 1);
    else if (event.key === "ArrowLeft") seek(frame - 1);
    else return;
    event.preventDefault();
  });
  for (const jump of document.querySelectorAll("[data-seek]"))
    jump.onclick = () => {
      if (playing) play(false);
      seek(nearest(Number(jump.dataset.seek)));
      root.scrollIntoView({ behavior: "smooth" });
    };
  for (const strip of document.querySelectorAll(".timeline"))
    strip.onclick = (event) => {
      const box = strip.getBoundingClientRect();
      if (playing) play(false);
      const begin = Number(strip.dataset.begin), end = Number(strip.dataset.end);
      seek(nearest(begin + ((end - begin) * (event.clientX - box.left)) / box.width));
    };

  function resize() {
    const width = stage.clientWidth, height = stage.clientHeight;
    renderer.setSize(width, height, false);
    eye.aspect = width / height;
    eye.updateProjectionMatrix();
  }
  new ResizeObserver(resize).observe(stage);
  resize();
  function draw() {
    if (playing) {
      const k = has_video ? Math.floor(video.currentTime * scene_data.fps + 1e-3)
        : began + Math.floor(((performance.now() - since) / 1000) * scene_data.fps * rate());
      show(k);
      if (k >= n_frames - 1 || (has_video && video.ended)) play(false);
    }
    controls.update();
    renderer.render(scene, eye);
    requestAnimationFrame(draw);
  }
  const asked = /[#&]t=([\d.]+)/.exec(location.hash);
  seek(asked ? nearest(Number(asked[1])) : 0);
  if (has_video && video.readyState < 2) video.addEventListener("loadeddata", () => seek(frame), { once: true });
  draw();
  root.dataset.state = "ready";
})().catch((error) => {
  document.getElementById("player").dataset.state = "failed";
  document.getElementById("player-stage").textContent = "The player failed: " + error;
});
