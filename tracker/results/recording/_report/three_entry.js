// What player.js uses of three.js 0.187.0 (MIT, see THREE_LICENSE.txt). three.min.js.gz is made of this file:
//   npm install three@0.187.0 esbuild && npx esbuild three_entry.js --bundle --minify --format=iife \
//     --global-name=THREE --legal-comments=inline --outfile=three.min.js && gzip -n -9 three.min.js
export { AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, GridHelper, Group, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Quaternion, SRGBColorSpace, Scene, Vector3, VideoTexture, WebGLRenderer } from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
