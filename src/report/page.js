// Shows the values under the pointer. Points are read back from the drawing itself.
document.querySelectorAll('svg.plot').forEach(svg=>{
 const nums=k=>svg.dataset[k].split(',').map(Number),[bx,by,bw,bh]=nums('box'),X=nums('x'),Y=nums('y');
 const hover=svg.querySelector('.hover'),lines=[...svg.querySelectorAll('[data-name]')].map(p=>({
  name:p.dataset.name,points:(p.getAttribute('d').match(/[ML][^MLh]+/g)||[]).map(s=>s.slice(1).split(' ').map(Number))}));
 const sx=v=>X[0]+(v-bx)/bw*(X[1]-X[0]),sy=v=>Y[1]-(v-by)/bh*(Y[1]-Y[0]),show=v=>+v.toPrecision(4);
 svg.addEventListener('pointerleave',()=>hover.innerHTML='');
 svg.addEventListener('pointermove',e=>{
  const m=svg.getScreenCTM().inverse(),x=e.clientX*m.a+e.clientY*m.c+m.e;
  if(x<bx||x>bx+bw){hover.innerHTML='';return}
  const rows=[show(sx(x))+''];
  lines.forEach(l=>{let best=null;l.points.forEach(p=>{if(!best||Math.abs(p[0]-x)<Math.abs(best[0]-x))best=p});
   if(best&&Math.abs(best[0]-x)<6)rows.push((l.name||'value')+'  '+show(sy(best[1])))});
  const w=Math.max(...rows.map(r=>r.length))*6.2+12,left=x+w+10>bx+bw?x-w-6:x+6,esc=t=>t.replace(/&/g,'&amp;').replace(/</g,'&lt;');
  hover.innerHTML=`<line x1="${x}" x2="${x}" y1="${by}" y2="${by+bh}"/><rect x="${left}" y="${by+4}" width="${w}" height="${rows.length*14+6}" rx="3"/>`+
   rows.map((r,i)=>`<text x="${left+6}" y="${by+17+i*14}">${esc(r)}</text>`).join('');
 });
});
